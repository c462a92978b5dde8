"""Serial frames as a board makes and reads them, byte by byte."""

from __future__ import annotations

__all__ = ["LineReader", "crc", "frame"]

_MTU = 512


def crc(payload: bytes) -> int:
    """CRC-16/ARC, bit by bit as firmware without a table does it."""
    register = 0
    for byte in payload:
        register ^= byte
        for _ in range(8):
            register = (register >> 1) ^ 0xA001 if register & 1 else register >> 1
    return register


_TABLE = [crc(bytes((value,))) for value in range(256)]


def _fast_crc(payload: bytes) -> int:
    register = 0
    for byte in payload:
        register = (register >> 8) ^ _TABLE[(register ^ byte) & 0xFF]
    return register


def frame(payload: bytes, source: int = 0, destination: int = 0) -> bytes:
    """One message, framed."""
    checksum = _fast_crc(payload)
    size = len(payload)
    plain = [source, destination, size & 0xFF, size >> 8, *payload, checksum & 0xFF, checksum >> 8]
    out = bytearray([0x7E])
    for byte in plain:
        if byte in (0x7E, 0x7D):
            out += bytes((0x7D, byte ^ 0x20))
        else:
            out.append(byte)
    return bytes(out)


class LineReader:
    """Finds messages for this board in what comes along the line.

    Args:
        address: Of the board: 0 with a custom transport, 1 with the serial one.
    """

    def __init__(self, address: int = 0) -> None:
        self._address = address
        self._bytes: list[int] | None = None
        self._escaped = False
        self.broken = 0

    def feed(self, data: bytes) -> list[bytes]:
        """The messages that are complete with these bytes."""
        found = []
        for byte in data:
            if byte == 0x7E:
                self._bytes, self._escaped = [], False
            elif self._bytes is None:
                continue
            elif byte == 0x7D:
                self._escaped = True
            else:
                self._bytes.append(byte ^ 0x20 if self._escaped else byte)
                self._escaped = False
                message = self._complete(self._bytes)
                if message is not None:
                    found.append(message)
        return found

    def _complete(self, got: list[int]) -> bytes | None:
        if len(got) < 4:
            return None
        size = got[2] | got[3] << 8
        if size > _MTU:
            self._bytes = None
        if len(got) < size + 6:
            return None
        self._bytes = None
        payload = bytes(got[4 : size + 4])
        if _fast_crc(payload) != (got[-2] | got[-1] << 8):
            self.broken += 1
            return None
        return payload if (got[0], got[1]) == (0, self._address) else None
