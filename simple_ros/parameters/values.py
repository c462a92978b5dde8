"""Values of parameters, their types, and what a declaration allows.

A value is a bool, an int of 64 bits, a float, a str, bytes, or a list of values of one of these types.
Types are written ``bool``, ``int``, ``float``, ``string``, ``bytes``, and ``int[]`` for a list of int.
The empty list is of every list type. An int is taken where a float is declared, never the reverse.
"""

from __future__ import annotations

import math
import numbers
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

from simple_ros.parameters.errors import (
    ParameterConflict,
    ParameterOutOfRange,
    ParameterTypeMismatch,
)

__all__ = [
    "EMPTY_LIST",
    "TYPES",
    "Descriptor",
    "Scalar",
    "Value",
    "checked",
    "coerced",
    "described",
    "normalised",
    "shown",
    "type_of",
]

Scalar: TypeAlias = bool | int | float | str | bytes
Value: TypeAlias = Scalar | list[bool] | list[int] | list[float] | list[str] | list[bytes]

SCALARS = ("bool", "int", "float", "string", "bytes")
TYPES = (*SCALARS, *(f"{kind}[]" for kind in SCALARS))
EMPTY_LIST = "[]"
"""The type of a list with nothing in it, which may become any list."""

_INT_MIN, _INT_MAX = -(2**63), 2**63 - 1
_STEP_TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True)
class Descriptor:
    """What a node says about a parameter it declares.

    Attributes:
        type: Its type.
        description: For people; one line.
        minimum: Least value that is allowed, for numbers and each number of a list.
        maximum: Greatest value that is allowed.
        step: Allowed values are this far apart, counted from the minimum (from 0 without one).
        choices: The values that are allowed; empty for any.
        read_only: Whether it keeps the value it has at its declaration.
    """

    type: str
    description: str = ""
    minimum: float | None = None
    maximum: float | None = None
    step: float | None = None
    choices: tuple[Scalar, ...] = ()
    read_only: bool = False


def normalised(name: str, value: Any) -> Value:
    """A value as parameters keep it: plain Python types, tuples and arrays as lists.

    Raises:
        ParameterTypeMismatch: No parameter can have it; the message says why.
    """
    if hasattr(value, "tolist"):  # numpy
        value = value.tolist()
    if isinstance(value, list | tuple):
        return _list(name, value)
    return _scalar(name, value)


def _scalar(name: str, value: Any) -> Scalar:
    if isinstance(value, bool):
        return value
    if isinstance(value, numbers.Integral):
        number = int(value)
        if not _INT_MIN <= number <= _INT_MAX:
            raise ParameterTypeMismatch(name, f"{number} does not fit an int of 64 bits")
        return number
    if isinstance(value, numbers.Real):
        return float(value)
    if isinstance(value, str):
        return _text(name, value)
    if isinstance(value, bytes | bytearray | memoryview):
        return bytes(value)
    kind = "null" if value is None else type(value).__name__
    raise ParameterTypeMismatch(
        name, f"cannot be {kind}; bool, int, float, string, bytes and lists of one of them can"
    )


def _text(name: str, value: str) -> str:
    try:
        value.encode()
    except UnicodeEncodeError:
        raise ParameterTypeMismatch(name, f"{value!r} is no valid Unicode text") from None
    return str(value)


def _list(name: str, items: Sequence[Any]) -> Value:
    values: list[Any] = [_item(name, item) for item in items]
    kinds = sorted({type_of(value) for value in values})
    if kinds == ["float", "int"]:
        return [float(value) for value in values]
    if len(kinds) > 1:
        raise ParameterTypeMismatch(name, f"mixes {' and '.join(kinds)} in one list")
    return values


def _item(name: str, item: Any) -> Scalar:
    if isinstance(item, list | tuple | dict):
        raise ParameterTypeMismatch(name, f"cannot have a {type(item).__name__} within a list")
    return _scalar(name, item)


def type_of(value: Any) -> str:
    """The type of a value that is normalised already."""
    match value:
        case bool():
            return "bool"
        case int():
            return "int"
        case float():
            return "float"
        case str():
            return "string"
        case bytes():
            return "bytes"
        case []:
            return EMPTY_LIST
        case _:
            return f"{type_of(value[0])}[]"


def shown(value: Any) -> str:
    """A value in a message, shortened if it is long."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:56]} ..."


def coerced(name: str, declared: str, value: Value) -> Value:
    """The value in the declared type: itself, or made wider.

    Raises:
        ParameterTypeMismatch: It is of another type.
    """
    found: Any = value
    match declared, type_of(value):
        case "float", "int":
            return float(found)
        case "float[]", "int[]":
            return [float(item) for item in found]
        case (_, given) if given == declared or (given == EMPTY_LIST and declared.endswith("[]")):
            return value
        case _, given:
            raise ParameterTypeMismatch(
                name, f"is declared {declared}, but {shown(value)} is {_named(given)}"
            )


def _named(kind: str) -> str:
    return "a list" if kind == EMPTY_LIST else kind


def checked(name: str, descriptor: Descriptor, value: Value) -> Value:
    """The value as a declaration takes it.

    Raises:
        ParameterTypeMismatch: It is of another type.
        ParameterOutOfRange: It is not allowed.
    """
    found = coerced(name, descriptor.type, value)
    for item in found if isinstance(found, list) else [found]:
        if descriptor.choices and item not in descriptor.choices:
            allowed = ", ".join(map(repr, descriptor.choices))
            raise ParameterOutOfRange(name, f"{item!r} is none of {allowed}")
        if isinstance(item, int | float):
            _check_number(name, descriptor, item)
    return found


def _check_number(name: str, descriptor: Descriptor, item: float) -> None:
    low, high, step = descriptor.minimum, descriptor.maximum, descriptor.step
    if low is not None and not item >= low:
        raise ParameterOutOfRange(name, f"{item!r} is less than its minimum {low!r}")
    if high is not None and not item <= high:
        raise ParameterOutOfRange(name, f"{item!r} is more than its maximum {high!r}")
    if step is not None and not _on_step(item, low or 0, step):
        start = f" from {low!r}" if low else ""
        raise ParameterOutOfRange(name, f"{item!r} is no multiple of its step {step!r}{start}")


def _on_step(item: float, start: float, step: float) -> bool:
    if isinstance(item, int) and isinstance(start, int) and isinstance(step, int):
        return (item - start) % step == 0
    if not math.isfinite(item):
        return False
    steps = (item - start) / step
    return math.isclose(steps, round(steps), rel_tol=_STEP_TOLERANCE, abs_tol=_STEP_TOLERANCE)


def described(name: str, default: Value, given: Descriptor) -> Descriptor:
    """A declaration made complete: its type from the default, its limits checked.

    Args:
        name: Of the parameter.
        default: Its default, normalised.
        given: What was said; an empty type is found from the default.

    Raises:
        ParameterConflict: The declaration contradicts itself.
    """
    kind = given.type or type_of(default)
    if kind == EMPTY_LIST:
        raise ParameterConflict(name, "an empty default needs its type said, such as 'float[]'")
    if kind not in TYPES:
        raise ParameterConflict(name, f"there is no type {kind!r}; there are {', '.join(TYPES)}")
    limits = (given.minimum, given.maximum, given.step)
    if any(limit is not None for limit in limits) and not kind.startswith(("int", "float")):
        raise ParameterConflict(name, f"minimum, maximum and step mean nothing for {kind}")
    if given.step is not None and not given.step > 0:
        raise ParameterConflict(name, f"its step must be more than 0, not {given.step!r}")
    low, high = given.minimum, given.maximum
    if low is not None and high is not None and low > high:
        raise ParameterConflict(name, f"its minimum {low!r} is more than its maximum {high!r}")
    return replace(given, type=kind, choices=_choices(name, kind.removesuffix("[]"), given))


def _choices(name: str, kind: str, given: Descriptor) -> tuple[Scalar, ...]:
    scalars: list[Any] = [coerced(name, kind, _scalar(name, item)) for item in given.choices]
    return tuple(scalars)
