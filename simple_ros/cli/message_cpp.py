"""Messages as the tools of C++ simple_ros print them."""

from __future__ import annotations

import math
import struct
from typing import TYPE_CHECKING, Any

from simple_ros.cli.message_fields import Descriptor, FieldDescriptor, is_map, is_repeated
from simple_ros.cli.message_text import enum_text

if TYPE_CHECKING:
    from google.protobuf.message import Message

__all__ = ["cpp_text"]


def cpp_text(message: Message) -> str:
    """What ``rostopic echo`` of C++ simple_ros prints for a message, with its blank line.

    Numbers as protobuf's C++ ``SimpleDtoa`` writes them, which Python's text_format does not: 15 or
    17 digits (6 or 9 in single precision), no ``.0``.
    """
    lines = _cpp_lines(message)
    return "".join(f"{line}\n" for line in (f"[{message.DESCRIPTOR.full_name}]", *lines, ""))


def _cpp_lines(message: Message) -> list[str]:
    from google.protobuf import message_factory

    lines: list[str] = []
    for field, value in message.ListFields():
        if is_map(field):
            pair: Descriptor = field.message_type
            entry = message_factory.GetMessageClass(pair)
            values = [entry(key=key, value=value[key]) for key in sorted(value)]
        else:
            values = value if is_repeated(field) else [value]
        for item in values:
            if field.message_type is None:
                lines.append(f"{field.name}: {_cpp_value(field, item)}")
            else:
                inner = (f"  {line}" for line in _cpp_lines(item))
                lines += [f"{field.name} {{", *inner, "}"]
    return lines


def _cpp_value(field: FieldDescriptor, value: Any) -> str:
    from google.protobuf import text_encoding

    if field.enum_type is not None:
        return enum_text(field, value)
    match value:
        case bool():
            return "true" if value else "false"
        case str() | bytes():
            raw = value.encode() if isinstance(value, str) else value
            return f'"{text_encoding.CEscape(raw, as_utf8=False)}"'
        case float():
            return _cpp_float(value, single=field.type == field.TYPE_FLOAT)
        case _:
            return str(value)


def _cpp_float(value: float, *, single: bool) -> str:
    short, long, code = (6, 9, "f") if single else (15, 17, "d")
    text = f"{value:.{short}g}"
    if not math.isfinite(value) or struct.pack(code, float(text)) == struct.pack(code, value):
        return text
    return f"{value:.{long}g}"
