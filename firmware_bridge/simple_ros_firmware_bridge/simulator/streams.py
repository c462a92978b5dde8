"""The two reliable streams of a board, with the habits of Micro-XRCE-DDS-Client."""

from __future__ import annotations

import struct

__all__ = ["BoardInput", "BoardOutput"]

_SLOTS = 4
_HEARTBEAT_S = 0.1


def _ahead(start: int, end: int) -> int:
    difference = (end - start) & 0xFFFF
    return difference - 0x10000 if difference & 0x8000 else difference


class BoardOutput:
    """To the agent: four slots, kept until they are acknowledged."""

    def __init__(self) -> None:
        self.slots: dict[int, bytes] = {}
        self.next = 0
        self.sends = 0
        self.messages = 0
        self.heartbeat_at: float | None = None

    @property
    def free(self) -> int:
        """Slots that are free."""
        return _SLOTS - len(self.slots)

    def put(self, body: bytes, now: float) -> tuple[int, bytes]:
        """A message into a slot; gives its number."""
        number = self.next
        self.next = (number + 1) & 0xFFFF
        self.slots[number] = body
        self.sends += 1
        self.messages += 1
        self.heartbeat_at = now + _HEARTBEAT_S
        return number, body

    def acknack(self, first: int, missing: int, now: float) -> list[tuple[int, bytes]]:
        """What the agent has and what it wants again."""
        for number in [number for number in self.slots if _ahead(number, first) > 0]:
            del self.slots[number]
        # The client moves its heartbeat away whenever anything comes.
        self.heartbeat_at = now + _HEARTBEAT_S if self.slots else None
        wanted = [(first + bit) & 0xFFFF for bit in range(16) if missing >> bit & 1]
        again = [(number, self.slots[number]) for number in wanted if number in self.slots]
        self.sends += len(again)
        return again

    def heartbeat(self, now: float) -> bytes | None:
        """The HEARTBEAT that is due."""
        if self.heartbeat_at is None or now < self.heartbeat_at or not self.slots:
            return None
        self.heartbeat_at = now + _HEARTBEAT_S
        last = (self.next - 1) & 0xFFFF
        return b"\x0b\x01\x05\x00" + struct.pack("<HHB", next(iter(self.slots)), last, 0x80)


class BoardInput:
    """From the agent: in order, four slots for what came too early."""

    def __init__(self) -> None:
        self.last = 0xFFFF
        self._early: dict[int, bytes] = {}
        self.overrun = 0

    def put(self, number: int, body: bytes) -> list[bytes]:
        """A message; gives what can be handled now."""
        ahead = _ahead(self.last, number)
        if ahead > _SLOTS:
            self.overrun += 1
        elif ahead > 0:
            self._early[number] = body
        ready = []
        while (body := self._early.pop((self.last + 1) & 0xFFFF, b"")) != b"":
            ready.append(body)
            self.last = (self.last + 1) & 0xFFFF
        return ready

    def acknack(self, announced: int | None = None) -> bytes:
        """What it has and what it lacks."""
        first = (self.last + 1) & 0xFFFF
        numbers = [_ahead(first, number) for number in self._early]
        highest = max([*numbers, -1 if announced is None else _ahead(first, announced)], default=-1)
        missing = sum(
            1 << bit
            for bit in range(min(highest + 1, 16))
            if (first + bit) & 0xFFFF not in self._early
        )
        return b"\x0a\x01\x05\x00" + struct.pack("<H", first) + missing.to_bytes(2, "big") + b"\x80"
