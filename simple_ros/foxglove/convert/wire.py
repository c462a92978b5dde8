"""Large fields of serialised messages: taken out and put in without parsing what they hold.

A picture then is copied once on its way from one message type into another.
"""

from __future__ import annotations

from google.protobuf.message import Message

__all__ = ["split", "with_bytes"]

_LENGTH_DELIMITED = 2
_FIXED_SIZES = {1: 8, 5: 4}
_MAX_SHIFT = 63


def split(message: bytes, number: int) -> tuple[memoryview, bytes]:
    """The content of a ``bytes`` field as a view, and the message without it.

    Args:
        message: Serialised.
        number: Of the field.

    Returns:
        The content, of the last such field if there are several and empty if there is none, and
        the other fields.

    Raises:
        ValueError: The message is cut off or malformed.
    """
    view = memoryview(message)
    content = view[:0]
    rest = []
    position = kept = 0
    while position < len(view):
        start = position
        key, position = _varint_at(view, position)
        if key >> 3 == number and key & 7 == _LENGTH_DELIMITED:
            size, position = _varint_at(view, position)
            rest.append(view[kept:start])
            content = view[position : position + size]
            position = kept = position + size
        else:
            position = _end_of_value(view, position, key & 7)
    if position > len(view):
        raise ValueError("the message is cut off")
    rest.append(view[kept:])
    return content, b"".join(rest)


def with_bytes(message: Message, number: int, content: bytes | memoryview) -> bytes:
    """A message serialised, with the content of a ``bytes`` field it does not have yet."""
    head = _varint(number << 3 | _LENGTH_DELIMITED) + _varint(len(content))
    return b"".join((message.SerializeToString(), head, content))


def _end_of_value(view: memoryview, position: int, kind: int) -> int:
    if kind == 0:
        return _varint_at(view, position)[1]
    if kind == _LENGTH_DELIMITED:
        size, position = _varint_at(view, position)
        return position + size
    if kind in _FIXED_SIZES:
        return position + _FIXED_SIZES[kind]
    raise ValueError(f"the message has a field of the unknown wire type {kind}")


def _varint_at(view: memoryview, position: int) -> tuple[int, int]:
    value = shift = 0
    while position < len(view) and shift <= _MAX_SHIFT:
        byte = view[position]
        position += 1
        value |= (byte & 127) << shift
        if byte < 128:
            return value, position
        shift += 7
    raise ValueError("the message is cut off or malformed")


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    out.append(value)
    return bytes(out)
