"""Taking one large field out of a serialised protobuf message, and putting one in, without copying it.

The encoding is protobuf's: a message is a sequence of ``tag, value``, where a tag is the varint ``number * 8 +
wire type``; of a field that comes twice the last one counts.
"""

from __future__ import annotations

__all__ = ["LENT_BYTES", "field_head", "split_field"]

LENT_BYTES = 64 * 1024
"""Payloads of this size on stay valid as long as anybody holds a view of them."""

_VARINT, _FIXED64, _LENGTH, _FIXED32 = 0, 1, 2, 5
_FIXED = {_FIXED64: 8, _FIXED32: 4}
_MOST_VARINT = 10


def field_head(number: int, size: int) -> bytes:
    """What stands before the value of a bytes field: its tag and its length."""
    return _varint(number << 3 | _LENGTH) + _varint(size)


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def split_field(data: memoryview, number: int) -> tuple[bytes, memoryview]:
    """A message without one of its bytes fields, and that field as a view; empty if it is not set.

    Raises:
        ValueError: The data is no protobuf message.
    """
    position, end = 0, len(data)
    begin = stop = 0
    others: list[memoryview] = []
    kept_from = 0
    while position < end:
        start = position
        tag, position = _read_varint(data, position)
        value_at = position
        position = _after_value(data, position, tag & 7)
        if position > end:
            raise ValueError(f"field {tag >> 3} goes beyond the end of the message")
        if tag >> 3 == number and tag & 7 == _LENGTH:
            others.append(data[kept_from:start])
            kept_from = stop = position
            _, begin = _read_varint(data, value_at)
    others.append(data[kept_from:end])
    return b"".join(others), data[begin:stop]


def _after_value(data: memoryview, position: int, wire_type: int) -> int:
    if wire_type == _LENGTH:
        size, position = _read_varint(data, position)
        return position + size
    if wire_type == _VARINT:
        return _read_varint(data, position)[1]
    if wire_type in _FIXED:
        return position + _FIXED[wire_type]
    raise ValueError(f"wire type {wire_type} at byte {position}")


def _read_varint(data: memoryview, position: int) -> tuple[int, int]:
    value = shift = 0
    for byte in data[position : position + _MOST_VARINT]:
        value |= (byte & 0x7F) << shift
        position += 1
        if byte < 0x80:
            return value, position
        shift += 7
    raise ValueError(f"a varint does not end at byte {position}")
