"""JSON of apps as our messages. Pure.

Apps fill in what they know of a message, in the habits of ROS: times as ``{"sec": 1, "nsec": 2}``, bytes as
lists of numbers, fields we do not have. All of that is understood here; what is left is the JSON mapping
of protobuf.
"""

from __future__ import annotations

import base64
import binascii
import json
from typing import Any, TypeVar

from google.protobuf import json_format
from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.duration_pb2 import Duration
from google.protobuf.message import Message
from google.protobuf.timestamp_pb2 import Timestamp

from simple_ros.foxglove.errors import PublishRefused

__all__ = ["json_of", "message_of"]

M = TypeVar("M", bound=Message)

_SECONDS = ("sec", "secs", "seconds")
_NANOS = ("nsec", "nsecs", "nanosec", "nanos", "nanoseconds")
_TIMES: dict[str, type[Timestamp | Duration]] = {
    "google.protobuf.Timestamp": Timestamp,
    "google.protobuf.Duration": Duration,
}
_FLOATS = (FieldDescriptor.CPPTYPE_FLOAT, FieldDescriptor.CPPTYPE_DOUBLE)
_MAX_DEPTH = 100


def message_of(message_class: type[M], payload: bytes) -> M:
    """The message that a JSON text describes; unknown fields are left out.

    Raises:
        PublishRefused: It is no JSON, or a value does not fit its field.
    """
    name = message_class.DESCRIPTOR.full_name
    try:
        value = json.loads(payload)
    except (ValueError, RecursionError) as error:
        raise PublishRefused(f"not a {name}: no JSON ({error})") from None
    if not isinstance(value, dict):
        raise PublishRefused(f"not a {name}: no JSON object")
    try:
        prepared = _message(message_class.DESCRIPTOR, value, 0)
        return json_format.ParseDict(prepared, message_class(), ignore_unknown_fields=True)
    except (json_format.ParseError, ValueError, TypeError, OverflowError, RecursionError) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise PublishRefused(f"not a {name}: {reason}") from None


def json_of(message: Message) -> bytes:
    """A message as JSON, with the names of its fields as they are, and all of them."""
    value = json_format.MessageToDict(
        message, preserving_proto_field_name=True, always_print_fields_with_no_presence=True
    )
    return json.dumps(value, separators=(",", ":")).encode()


def _message(descriptor: Any, value: Any, depth: int) -> Any:
    if depth > _MAX_DEPTH:
        raise ValueError("it is nested too deeply")
    made = _TIMES.get(descriptor.full_name)
    if made is not None and isinstance(value, dict):
        seconds, nanos = _number_in(value, _SECONDS), _number_in(value, _NANOS)
        return made(seconds=seconds, nanos=nanos).ToJsonString()
    if descriptor.full_name.startswith("google.protobuf.") or not isinstance(value, dict):
        return value
    fields = {field.json_name: field for field in descriptor.fields}
    fields |= {field.name: field for field in descriptor.fields}
    if descriptor.full_name.startswith("builtin_interfaces."):
        value = {"sec": _number_in(value, _SECONDS), "nanosec": _number_in(value, _NANOS)}
    return {
        name: _field(fields[name], item, depth)
        for name, item in value.items()
        if name in fields and item is not None
    }


def _number_in(value: dict[str, Any], names: tuple[str, ...]) -> int:
    return next((int(value[name] or 0) for name in names if name in value), 0)


def _field(field: Any, value: Any, depth: int) -> Any:
    inner = field.message_type
    if inner is not None and inner.GetOptions().map_entry and isinstance(value, dict):
        kind = inner.fields_by_name["value"]
        return {key: _item(kind, item, depth) for key, item in value.items()}
    if field.is_repeated:
        return [_item(field, item, depth) for item in _as_list(value)]
    return _item(field, value, depth)


def _as_list(value: Any) -> list[Any]:
    """A list; a typed array of JavaScript becomes an object with its indices as names."""
    if isinstance(value, dict) and all(name.isdigit() for name in value):
        return [value[name] for name in sorted(value, key=int)]
    if not isinstance(value, list):
        raise TypeError(f"a list is wanted, not {value!r:.40}")
    return value


def _item(field: Any, value: Any, depth: int) -> Any:
    if field.message_type is not None:
        return _message(field.message_type, value, depth + 1)
    if value is None and field.cpp_type in _FLOATS:
        # JavaScript writes numbers that are not finite so; only in lists does it matter.
        return "NaN"
    if field.type == FieldDescriptor.TYPE_BYTES:
        return _bytes(field, value)
    if field.type == FieldDescriptor.TYPE_BOOL and value in (0, 1):
        return bool(value)
    return value


def _bytes(field: Any, value: Any) -> str:
    """Bytes as base64, whichever way they came."""
    if isinstance(value, str):
        try:
            base64.b64decode(value, validate=True)
        except (binascii.Error, ValueError):
            raise TypeError(f"{field.name}: a text for bytes must be base64") from None
        return value
    return base64.b64encode(bytes(_as_list(value))).decode()
