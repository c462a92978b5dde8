"""Protobuf's encoding, as far as large fields are taken out of messages and put in without copying them.

A message is a sequence of ``tag, value``, where a tag is the varint ``number * 8 + wire type``; of a field that
comes twice the last one counts.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from google.protobuf.message import Message

__all__ = ["Field", "field_head", "fields_of", "split_field", "with_field"]

_VARINT, _FIXED64, _LENGTH, _FIXED32 = 0, 1, 2, 5
_FIXED = {_FIXED64: 8, _FIXED32: 4}
_MOST_VARINT = 10


class Field(NamedTuple):
    """Where a field stands in a message.

    Attributes:
        number: Its number.
        is_bytes: Whether it is bytes, text, a message or packed numbers.
        start: Of its tag.
        begin: Of its content, behind tag and length.
        end: Behind it.
    """

    number: int
    is_bytes: bool
    start: int
    begin: int
    end: int


def field_head(number: int, size: int) -> bytes:
    """What stands before the content of a bytes field: its tag and its length."""
    return _varint(number << 3 | _LENGTH) + _varint(size)


def with_field(message: Message, number: int, content: bytes | memoryview) -> bytes:
    """A message serialised, with the content of a bytes field that it does not have yet."""
    return b"".join((message.SerializeToString(), field_head(number, len(content)), content))


def fields_of(data: bytes | memoryview) -> Iterator[Field]:
    """The fields of a message, in order.

    Raises:
        ValueError: The data is no protobuf message.
    """
    view = memoryview(data)
    position, end = 0, len(view)
    while position < end:
        start = position
        tag, position = _read_varint(view, position)
        wire_type = tag & 7
        begin = position
        if wire_type == _LENGTH:
            size, begin = _read_varint(view, position)
            position = begin + size
        elif wire_type == _VARINT:
            _, position = _read_varint(view, position)
        elif wire_type in _FIXED:
            position += _FIXED[wire_type]
        else:
            raise ValueError(f"wire type {wire_type} at byte {start}")
        if position > end:
            raise ValueError(f"field {tag >> 3} goes beyond the end of the message")
        yield Field(tag >> 3, wire_type == _LENGTH, start, begin, position)


def split_field(data: bytes | memoryview, number: int) -> tuple[bytes, memoryview]:
    """A message without one of its bytes fields, and that field as a view; empty if it is not set.

    Raises:
        ValueError: The data is no protobuf message.
    """
    view = memoryview(data)
    content = view[:0]
    others: list[memoryview] = []
    kept_from = 0
    for field in fields_of(view):
        if field.number == number and field.is_bytes:
            others.append(view[kept_from : field.start])
            content = view[field.begin : field.end]
            kept_from = field.end
    others.append(view[kept_from:])
    return b"".join(others), content


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def _read_varint(data: memoryview, position: int) -> tuple[int, int]:
    value = shift = 0
    for byte in data[position : position + _MOST_VARINT]:
        value |= (byte & 0x7F) << shift
        position += 1
        if byte < 0x80:
            return value, position
        shift += 7
    raise ValueError(f"a varint does not end at byte {position}")
