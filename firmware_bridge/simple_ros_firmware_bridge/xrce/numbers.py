"""Numbers that count up modulo 2^16, compared by who is less than half a turn ahead."""

from __future__ import annotations

__all__ = ["after", "distance", "is_far_behind"]

_MODULUS = 1 << 16
_HALF = 1 << 15
_FAR = 128
"""Boards keep at most a few tens of messages: none that is older comes late, or again."""


def after(number: int, count: int = 1) -> int:
    """The number ``count`` places later."""
    return (number + count) % _MODULUS


def distance(start: int, end: int) -> int:
    """How far ``end`` is ahead of ``start``: -32768..32767, negative if it is behind."""
    return (end - start + _HALF) % _MODULUS - _HALF


def is_far_behind(start: int, end: int) -> bool:
    """Whether ``end`` is so far behind that it is no late message: its sender has counted round."""
    return distance(start, end) < -_FAR
