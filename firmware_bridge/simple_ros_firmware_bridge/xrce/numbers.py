"""Numbers that count up modulo 2^16, compared by who is less than half a turn ahead."""

from __future__ import annotations

__all__ = ["after", "distance"]

_MODULUS = 1 << 16
_HALF = 1 << 15


def after(number: int, count: int = 1) -> int:
    """The number ``count`` places later."""
    return (number + count) % _MODULUS


def distance(start: int, end: int) -> int:
    """How far ``end`` is ahead of ``start``: -32768..32767, negative if it is behind."""
    return (end - start + _HALF) % _MODULUS - _HALF
