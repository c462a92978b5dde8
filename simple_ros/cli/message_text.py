"""Messages as text for people and as JSON."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from simple_ros.cli.message_fields import (
    TIMESTAMP,
    WELL_KNOWN,
    FieldDescriptor,
    is_map,
    is_repeated,
    resolve,
)

if TYPE_CHECKING:
    from google.protobuf.message import Message

__all__ = ["enum_text", "field_json", "field_text", "message_json", "yaml_text"]

_MAX_ELEMENTS = 64
_MAX_BYTES = 16


def yaml_text(message: Message, *, full: bool = False) -> str:
    """A message as YAML-like text: all fields, also zeros; long lists and bytes cut unless ``full``."""
    return "\n".join(_message_lines(message, full=full)) or "{}"


def field_text(message: Message, path: Sequence[str], *, full: bool = False) -> str:
    """What a checked path leads to, as readable text.

    Raises:
        IndexError: A list of this message is shorter than the path wants.
    """
    parent, field, index = resolve(message, path)
    value = getattr(parent, field.name)
    if index is not None:
        return _value_text(field, value[index], full=full)
    if is_repeated(field):
        return "\n".join(_repeated_lines("", field, value, full=full)).removeprefix(": ")
    return _value_text(field, value, full=full)


def message_json(message: Message) -> Any:
    """A message as a value for JSON: field names as in the .proto file, zeros written.

    Raises:
        ValueError: It cannot be written, such as a time after the year 9999.
    """
    from google.protobuf import json_format

    try:
        return json_format.MessageToDict(
            message,
            preserving_proto_field_name=True,
            always_print_fields_with_no_presence=True,
        )
    except json_format.SerializeToJsonError as error:
        raise ValueError(str(error)) from None


def field_json(message: Message, path: Sequence[str]) -> Any:
    """What a checked path leads to, as a value for JSON.

    Raises:
        IndexError: A list of this message is shorter than the path wants.
    """
    parent, field, index = resolve(message, path)
    if parent.DESCRIPTOR.full_name.startswith(WELL_KNOWN):
        return getattr(parent, field.name)
    value = message_json(parent).get(field.name)
    return value if index is None or value is None else value[index]


def _message_lines(message: Message, *, full: bool) -> list[str]:
    lines: list[str] = []
    for field in message.DESCRIPTOR.fields:
        name = field.name
        if field.containing_oneof is not None and not message.HasField(name):
            continue
        if is_repeated(field):
            lines += _repeated_lines(name, field, getattr(message, name), full=full)
        elif field.message_type is not None and not message.HasField(name):
            lines.append(f"{name}: {{}}")
        else:
            lines += _entry_lines(f"{name}:", field, getattr(message, name), full=full)
    return lines


def _entry_lines(start: str, field: FieldDescriptor, value: Any, *, full: bool) -> list[str]:
    text = _value_text(field, value, full=full)
    if "\n" not in text and not (field.message_type is not None and ": " in text):
        return [f"{start} {text}"]
    return [start, *(f"  {line}" for line in text.split("\n"))]


def _repeated_lines(name: str, field: FieldDescriptor, values: Any, *, full: bool) -> list[str]:
    if is_map(field):
        return _map_lines(name, field, values, full=full)
    shown = values if full else values[:_MAX_ELEMENTS]
    missing = len(values) - len(shown)
    if field.message_type is None or not values:
        texts = [_value_text(field, value, full=full) for value in shown]
        if missing:
            texts.append(f"... {missing} more")
        return [f"{name}: [{', '.join(texts)}]"]
    lines = [f"{name}:"] if name else []
    for value in shown:
        first, *rest = _value_text(field, value, full=full).split("\n")
        lines += [f"- {first}", *(f"  {line}" for line in rest)]
    return [*lines, f"# ... {missing} more"] if missing else lines


def _map_lines(name: str, field: FieldDescriptor, values: Any, *, full: bool) -> list[str]:
    key, value = (field.message_type.fields_by_name[part] for part in ("key", "value"))
    if not values:
        return [f"{name}: {{}}"]
    lines = [f"{name}:"] if name else []
    for item in sorted(values):
        start = f"  {_value_text(key, item, full=full)}:"
        first, *rest = _entry_lines(start, value, values[item], full=full)
        lines += [first, *(f"  {line}" for line in rest)]
    return lines


def _value_text(field: FieldDescriptor, value: Any, *, full: bool) -> str:
    if field.message_type is not None:
        return _inner_text(value, full=full)
    if field.enum_type is not None:
        return enum_text(field, value)
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            return json.dumps(value, ensure_ascii=False)
        case bytes():
            return _bytes_text(value, full=full)
        case float():
            return _float_text(value, single=field.type == field.TYPE_FLOAT)
        case _:
            return str(value)


def _inner_text(value: Any, *, full: bool) -> str:
    if value.DESCRIPTOR.full_name in (TIMESTAMP, WELL_KNOWN + "Duration"):
        try:
            return str(value.ToJsonString())
        except ValueError:
            pass  # out of range: the two numbers are shown
    return yaml_text(value, full=full)


def enum_text(field: FieldDescriptor, value: int) -> str:
    """The name of a value of an enum, or its number."""
    known = field.enum_type.values_by_number.get(value)
    return str(value) if known is None else known.name


def _bytes_text(value: bytes, *, full: bool) -> str:
    shown = value if full else value[:_MAX_BYTES]
    more = " ..." if len(shown) < len(value) else ""
    return f"<{len(value)} bytes{' ' if value else ''}{shown.hex(' ')}{more}>"


def _float_text(value: float, *, single: bool) -> str:
    if not math.isfinite(value):
        return ".nan" if math.isnan(value) else (".inf" if value > 0 else "-.inf")
    if not single:
        return repr(value)
    for digits in range(6, 9):
        near = float(f"{value:.{digits}g}")
        if struct.pack("f", near) == struct.pack("f", value):
            return repr(near)
    return repr(float(f"{value:.9g}"))
