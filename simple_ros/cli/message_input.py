"""YAML or JSON as a message."""

from __future__ import annotations

import base64
import datetime as dt
import math
import re
from typing import TYPE_CHECKING, Any

from simple_ros.cli.message_fields import (
    WELL_KNOWN,
    Descriptor,
    FieldDescriptor,
    UnknownField,
    is_map,
    is_repeated,
)
from simple_ros.cli.text import one_line
from simple_ros.errors import SimpleRosError

if TYPE_CHECKING:
    from google.protobuf.message import Message

__all__ = ["BadMessageText", "message_of"]


_PARSING = re.compile(r"\bFailed to parse (\w+) field: ")


class BadMessageText(SimpleRosError, ValueError):
    """A text does not describe a message of the wanted type; the message says why."""


def message_of(message_class: type[Message], text: str) -> Message:
    """The message that YAML or JSON describes.

    Raises:
        UnknownField: The type has no field of a given name.
        BadMessageText: The text is no YAML or a value does not fit its field.
    """
    import yaml
    from google.protobuf import json_format

    descriptor = message_class.DESCRIPTOR
    try:
        value = yaml.safe_load(text)
    except yaml.YAMLError as error:
        reason = getattr(error, "problem", None) or str(error)
        mark = getattr(error, "problem_mark", None)
        place = f", line {mark.line + 1}, column {mark.column + 1}" if mark is not None else ""
        raise BadMessageText(f"the message is not YAML: {one_line(reason)}{place}") from None
    if value is None:
        value = {}
    if not isinstance(value, dict):
        fields = ", ".join(f"{name}: ..." for name in descriptor.fields_by_name)
        raise BadMessageText(
            f"{descriptor.full_name} is written as {{{fields}}}, not as {one_line(text)!r}"
        )
    prepared = _prepared(descriptor, value, "")
    try:
        return json_format.ParseDict(prepared, message_class())
    except json_format.ParseError as error:
        reason = _PARSING.sub(r"field '\1': ", one_line(str(error)).rstrip("."))
        raise BadMessageText(f"this is no {descriptor.full_name}: {reason}") from None


def _prepared(descriptor: Descriptor, value: Any, where: str) -> Any:
    """A value of YAML as json_format wants it.

    Raises:
        UnknownField: The type has no field of a given name.
        BadMessageText: Something else stands where a message belongs.
    """
    if descriptor.full_name.startswith(WELL_KNOWN):
        return _prepared_well_known(descriptor, value, where)
    if not isinstance(value, dict):
        raise BadMessageText(f"{where!r} is a {descriptor.full_name}, not {one_line(str(value))}")
    fields = {field.json_name: field for field in descriptor.fields}
    fields |= {field.name: field for field in descriptor.fields}
    prepared = {}
    for name, item in value.items():
        if name not in fields:
            raise UnknownField(str(name), descriptor.full_name, where, descriptor.fields_by_name)
        field = fields[name]
        prepared[name] = _prepared_field(field, item, f"{where}.{name}" if where else name)
    return prepared


def _prepared_field(field: FieldDescriptor, value: Any, where: str) -> Any:
    if is_map(field) and isinstance(value, dict):
        inner = field.message_type.fields_by_name["value"]
        return {
            _map_key(key): _prepared_field(inner, item, f"{where}.{key}")
            for key, item in value.items()
        }
    if is_repeated(field) and isinstance(value, list):
        return [_prepared_item(field, item, f"{where}.{i}") for i, item in enumerate(value)]
    return _prepared_item(field, value, where)


def _map_key(key: Any) -> str:
    return str(key).lower() if isinstance(key, bool) else str(key)


def _prepared_item(field: FieldDescriptor, value: Any, where: str) -> Any:
    if field.message_type is None or value is None:
        return _plain(value)
    return _prepared(field.message_type, value, where)


def _prepared_well_known(descriptor: Descriptor, value: Any, where: str) -> Any:
    """Times may also be given by their two numbers, as in ROS."""
    pair = isinstance(value, dict) and value.keys() <= {"seconds", "nanos"}
    if not pair or descriptor.name not in ("Timestamp", "Duration"):
        return _plain(value)
    from google.protobuf import duration_pb2, timestamp_pb2

    made = duration_pb2.Duration if descriptor.name == "Duration" else timestamp_pb2.Timestamp
    try:
        return made(**value).ToJsonString()
    except (TypeError, ValueError) as error:
        raise BadMessageText(f"{where!r} is no time: {one_line(str(error))}") from None


def _plain(value: Any) -> Any:
    """YAML knows more than JSON: times, bytes and numbers that are none."""
    match value:
        case dt.datetime():
            zoned = value if value.tzinfo else value.replace(tzinfo=dt.UTC)
            return zoned.isoformat()
        case dt.date():
            return value.isoformat()
        case bytes():
            return base64.b64encode(value).decode()
        case float() if not math.isfinite(value):
            return "NaN" if math.isnan(value) else ("Infinity" if value > 0 else "-Infinity")
        case dict():
            return {key: _plain(item) for key, item in value.items()}
        case list():
            return [_plain(item) for item in value]
        case _:
            return value
