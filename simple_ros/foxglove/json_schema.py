"""JSON schemas of messages, for what apps send and receive in JSON. Pure."""

from __future__ import annotations

import json
from typing import Any

from google.protobuf.descriptor import FieldDescriptor

__all__ = ["json_schema"]

_KINDS: dict[int, dict[str, Any]] = {
    FieldDescriptor.CPPTYPE_BOOL: {"type": "boolean"},
    FieldDescriptor.CPPTYPE_INT32: {"type": "integer"},
    FieldDescriptor.CPPTYPE_UINT32: {"type": "integer"},
    # protobuf's JSON writes them as texts, since JavaScript would round them.
    FieldDescriptor.CPPTYPE_INT64: {"type": ["integer", "string"]},
    FieldDescriptor.CPPTYPE_UINT64: {"type": ["integer", "string"]},
    FieldDescriptor.CPPTYPE_FLOAT: {"type": "number"},
    FieldDescriptor.CPPTYPE_DOUBLE: {"type": "number"},
}
_TIMES = {"google.protobuf.Timestamp": "date-time", "google.protobuf.Duration": "duration"}


def json_schema(descriptor: Any) -> str:
    """The schema of a message type as JSON text; a type within itself is any object there."""
    schema = _message(descriptor, ())
    return json.dumps({"title": descriptor.full_name, **schema}, separators=(",", ":"))


def _message(descriptor: Any, outer: tuple[str, ...]) -> dict[str, Any]:
    form = _TIMES.get(descriptor.full_name)
    if form is not None:
        return {"type": "string", "format": form}
    if descriptor.full_name in outer or descriptor.full_name.startswith("google.protobuf."):
        return {"type": "object"}
    inside = (*outer, descriptor.full_name)
    return {
        "type": "object",
        "properties": {field.name: _field(field, inside) for field in descriptor.fields},
    }


def _field(field: Any, outer: tuple[str, ...]) -> dict[str, Any]:
    inner = field.message_type
    if inner is not None and inner.GetOptions().map_entry:
        return {
            "type": "object",
            "additionalProperties": _item(inner.fields_by_name["value"], outer),
        }
    if field.is_repeated:
        return {"type": "array", "items": _item(field, outer)}
    return _item(field, outer)


def _item(field: Any, outer: tuple[str, ...]) -> dict[str, Any]:
    if field.message_type is not None:
        return _message(field.message_type, outer)
    if field.enum_type is not None:
        return {"enum": [value.name for value in field.enum_type.values]}
    if field.type == FieldDescriptor.TYPE_BYTES:
        return {"type": "string", "contentEncoding": "base64"}
    return _KINDS.get(field.cpp_type, {"type": "string"})
