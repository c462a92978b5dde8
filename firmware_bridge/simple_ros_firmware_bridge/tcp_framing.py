"""XRCE messages on a TCP connection: each behind its length, two bytes, little endian."""

from __future__ import annotations

__all__ = ["MessageReader", "encode_message"]

_LENGTH = 2


def encode_message(message: bytes) -> bytes:
    """The bytes that carry a message of at most 65535 bytes."""
    return len(message).to_bytes(_LENGTH, "little") + message


class MessageReader:
    """Takes bytes in any portions, gives messages. It never holds more than one message and a portion."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[bytes]:
        """The messages that are complete with these bytes; empty ones are left out."""
        self._buffer += data
        messages = []
        position = 0
        while (start := position + _LENGTH) <= len(self._buffer):
            end = start + int.from_bytes(self._buffer[position:start], "little")
            if end > len(self._buffer):
                break
            if end > start:
                messages.append(bytes(self._buffer[start:end]))
            position = end
        del self._buffer[:position]
        return messages
