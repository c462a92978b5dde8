"""CRC-16/ARC: polynomial 0x8005 reflected, start 0, no final xor; "123456789" gives 0xBB3D."""

from __future__ import annotations

import struct
from functools import cache

__all__ = ["crc16"]

_POLYNOMIAL = 0xA001


def _of_byte(value: int) -> int:
    for _ in range(8):
        value = (value >> 1) ^ (_POLYNOMIAL if value & 1 else 0)
    return value


_BYTES = tuple(_of_byte(value) for value in range(256))


@cache
def _words() -> tuple[int, ...]:
    """What two bytes at once do; a word replaces the whole register, so one step needs no shift."""
    return tuple(
        (first >> 8) ^ _BYTES[(first ^ high) & 0xFF] for high in range(256) for first in _BYTES
    )


def crc16(data: bytes) -> int:
    """The checksum of ``data``."""
    words = _words()
    crc = 0
    for (word,) in struct.iter_unpack("<H", data[: len(data) & ~1]):
        crc = words[crc ^ word]
    if len(data) & 1:
        crc = (crc >> 8) ^ _BYTES[(crc ^ data[-1]) & 0xFF]
    return crc
