"""Between parameters and what the Foxglove protocol calls so. Pure."""

from __future__ import annotations

import base64
import binascii
import math
from collections.abc import Mapping
from typing import Any

from simple_ros.foxglove.errors import InvalidRequest
from simple_ros.foxglove.graph_model import shown
from simple_ros.parameters.values import Value, normalised, type_of

__all__ = ["from_protocol", "to_protocol"]

_TYPES = {"float": "float64", "float[]": "float64_array", "bytes": "byte_array"}


def to_protocol(name: str, value: Value | None) -> dict[str, Any]:
    """A parameter as clients are told; without value if it has gone."""
    told: dict[str, Any] = {"name": shown(name)}
    if value is None:
        return told
    kind = type_of(value)
    items = value if isinstance(value, list) else [value]
    plain = [_plain(item) for item in items]
    told["value"] = plain if isinstance(value, list) else plain[0]
    if kind in _TYPES and all(_is_exact(item) for item in items):
        told["type"] = _TYPES[kind]
    return told


def _is_exact(item: Any) -> bool:
    return not isinstance(item, float) or math.isfinite(item)


def _plain(item: Any) -> Any:
    if isinstance(item, bytes):
        return base64.b64encode(item).decode()
    if not _is_exact(item):
        # JSON has no word for them.
        return "NaN" if math.isnan(item) else "Infinity" if item > 0 else "-Infinity"
    return item


def from_protocol(given: Mapping[str, Any], present: Value | None) -> Value:
    """The value that a client sets.

    Clients leave the type away, or write 3 for 3.0, so the parameter keeps the type it has.

    Args:
        given: The parameter as it came, with a ``value``.
        present: Its value now; None if there is none.

    Raises:
        InvalidRequest: Its type does not go with its value.
        ParameterTypeMismatch: No parameter can have the value.
    """
    name, value, kind = str(given["name"]), given["value"], given.get("type") or ""
    wanted = type_of(present) if present is not None else _named(kind)
    if isinstance(value, list) and (wanted.endswith("[]") or not wanted):
        element = wanted.removesuffix("[]")
        return normalised(name, [_as(name, element, item) for item in value])
    if wanted.endswith("[]") and wanted != "[]":
        return normalised(name, value)
    return normalised(name, _as(name, wanted, value))


def _named(kind: str) -> str:
    return next((ours for ours, theirs in _TYPES.items() if theirs == kind), "")


def _as(name: str, wanted: str, value: Any) -> Any:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if wanted == "float" and is_number:
        return float(value)
    if wanted == "float" and value in ("NaN", "Infinity", "-Infinity"):
        return float(value)
    if wanted == "int" and isinstance(value, float) and value.is_integer():
        return int(value)
    if wanted == "bytes" and isinstance(value, str):
        try:
            return base64.b64decode(value, validate=True)
        except (binascii.Error, ValueError):
            raise InvalidRequest(f"parameter {name}: bytes are written in base64") from None
    return value
