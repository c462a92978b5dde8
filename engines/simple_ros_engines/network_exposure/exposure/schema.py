"""Checking JSON against a schema: the few keywords of JSON Schema that ours use. Pure.

``type`` (one name), ``required``, ``properties``, ``items``, ``minItems``, ``maxItems``, ``enum``, ``pattern``,
``minLength``, ``minimum``, ``maximum``, ``minProperties``, ``additionalProperties`` (False only), ``oneOf``, ``anyOf``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeAlias

__all__ = ["Schema", "problems"]

Schema: TypeAlias = Mapping[str, Any]


def problems(value: Any, schema: Schema, where: str = "$") -> list[str]:
    """What is wrong with a value, each with its place; nothing if it is valid."""
    return list(_problems(value, schema, where))


_TYPES: dict[str, Callable[[Any], bool]] = {
    "object": lambda value: isinstance(value, dict),
    "array": lambda value: isinstance(value, list),
    "string": lambda value: isinstance(value, str),
    "boolean": lambda value: isinstance(value, bool),
    "integer": lambda value: isinstance(value, int) and not isinstance(value, bool),
    "number": lambda value: isinstance(value, int | float) and not isinstance(value, bool),
}


def _problems(value: Any, schema: Schema, where: str) -> Iterator[str]:
    kind = schema.get("type")
    if kind is not None and not _TYPES[kind](value):
        yield f"{where}: {type(value).__name__} instead of {kind}"
        return
    if "enum" in schema and value not in schema["enum"]:
        yield f"{where}: {value!r} is none of {', '.join(map(str, schema['enum']))}"
    match value:
        case dict():
            yield from _of_object(value, schema, where)
        case list():
            yield from _of_array(value, schema, where)
        case str():
            yield from _of_string(value, schema, where)
        case bool():
            pass
        case int() | float():
            yield from _of_number(value, schema, where)
    yield from _of_choices(value, schema, where)


def _of_object(value: dict[str, Any], schema: Schema, where: str) -> Iterator[str]:
    known: Mapping[str, Schema] = schema.get("properties", {})
    yield from (
        f"{where}: {name} is missing" for name in schema.get("required", ()) if name not in value
    )
    if len(value) < schema.get("minProperties", 0):
        yield f"{where}: fewer than {schema['minProperties']} properties"
    for name, item in value.items():
        if name in known:
            yield from _problems(item, known[name], f"{where}.{name}")
        elif schema.get("additionalProperties") is False:
            yield f"{where}: {name} is not known"


def _of_array(value: list[Any], schema: Schema, where: str) -> Iterator[str]:
    if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value)):
        yield f"{where}: {len(value)} items"
    if "items" in schema:
        for index, item in enumerate(value):
            yield from _problems(item, schema["items"], f"{where}[{index}]")


def _of_string(value: str, schema: Schema, where: str) -> Iterator[str]:
    if len(value) < schema.get("minLength", 0):
        yield f"{where}: shorter than {schema['minLength']} characters"
    if "pattern" in schema and not re.search(schema["pattern"], value):
        yield f"{where}: {value[:60]!r} does not match {schema['pattern']}"


def _of_number(value: float, schema: Schema, where: str) -> Iterator[str]:
    if not schema.get("minimum", value) <= value <= schema.get("maximum", value):
        yield f"{where}: {value} is out of range"


def _of_choices(value: Any, schema: Schema, where: str) -> Iterator[str]:
    for name, most in (("oneOf", 1), ("anyOf", len(schema.get("anyOf", ())))):
        if name in schema:
            fitting = sum(not problems(value, choice, where) for choice in schema[name])
            if not 1 <= fitting <= most:
                yield f"{where}: fits {fitting} of the {len(schema[name])} forms it may have"
