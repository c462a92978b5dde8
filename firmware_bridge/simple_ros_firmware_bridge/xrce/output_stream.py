"""A reliable stream to a board: at most four messages under way, sent again when the board asks.

A board of the Pico SDK keeps four buffers of 512 bytes for messages that came out of order and does not
say so; whoever sends more overruns it. What does not fit waits with the sender of the samples.
"""

from __future__ import annotations

from dataclasses import dataclass

from simple_ros_firmware_bridge.xrce import wire
from simple_ros_firmware_bridge.xrce.numbers import after, distance

__all__ = ["WINDOW", "OutputCounters", "ReliableOutput"]

WINDOW = 4
_FLOOR_S = 0.02
_CEILING_S = 0.2
_START_S = 0.1
_SMOOTHING = 0.125
_ROUND_TRIPS = 3.0


@dataclass
class OutputCounters:
    """What happened on a stream.

    Attributes:
        messages: Sent, each counted once.
        resent: Sent again.
        heartbeats: Questions what the board has.
    """

    messages: int = 0
    resent: int = 0
    heartbeats: int = 0


class ReliableOutput:
    """Numbers messages, keeps them until the board has them.

    Args:
        stream: Its number.
        sequence: Number of the next message; None is asked of the board (after a restart).
    """

    def __init__(self, stream: int, sequence: int | None = 0) -> None:
        self.stream = stream
        self.counters = OutputCounters()
        self._next = sequence
        self._unacked: dict[int, bytes] = {}
        self._sent_at: dict[int, float] = {}
        self._round_trip_s = _START_S / _ROUND_TRIPS
        self._asked_at: float | None = None
        self._questions = 0

    @property
    def room(self) -> int:
        """How many messages may be sent now."""
        return 0 if self._next is None else WINDOW - len(self._unacked)

    def send(self, body: bytes, now: float) -> tuple[int, bytes]:
        """A message, numbered. Only call this while there is `room`."""
        assert self._next is not None
        assert self.room > 0
        number = self._next
        self._next = after(number)
        if not self._unacked:
            self._asked_at = now
            self._questions = 0
        self._unacked[number] = body
        self._sent_at[number] = now
        self.counters.messages += 1
        return number, body

    def acknowledged(self, first: int, missing: int, now: float) -> list[tuple[int, bytes]]:
        """The board has everything before ``first``; gives what it asks for, to be sent again.

        Args:
            first: The first it does not have.
            missing: Bit i set: ``first + i`` is missing.
            now: The time.
        """
        if self._next is None:
            self._next = first
            self._asked_at = None
            return []
        if not 0 <= distance(first, self._next) <= WINDOW:
            return []
        for number in [number for number in self._unacked if distance(number, first) > 0]:
            del self._unacked[number]
            sent_at = self._sent_at.pop(number, None)
            if sent_at is not None:
                self._round_trip_s += _SMOOTHING * (now - sent_at - self._round_trip_s)
            self._asked_at = now
            self._questions = 0
        wanted = [
            number for bit in range(16) if missing >> bit & 1 for number in (after(first, bit),)
        ]
        return [self._again(number) for number in wanted if number in self._unacked]

    def _again(self, number: int) -> tuple[int, bytes]:
        self._sent_at.pop(number, None)  # which of the two is answered is not known
        self.counters.resent += 1
        return number, self._unacked[number]

    def probe(self) -> bytes | None:
        """A HEARTBEAT for the sake of its answer; None while one is due anyway."""
        if self._next is None or self._unacked:
            return None
        self.counters.heartbeats += 1
        return wire.heartbeat(self._next, after(self._next, -1), self.stream)

    def next_timeout(self) -> float | None:
        """When to call `handle_timeout`, None if nothing is under way."""
        if self._next is not None and not self._unacked:
            return None
        if self._asked_at is None:
            return 0.0
        wait = max(_FLOOR_S, _ROUND_TRIPS * self._round_trip_s) * float(2**self._questions)
        return self._asked_at + min(_CEILING_S, wait)

    def handle_timeout(self, now: float) -> bytes | None:
        """The HEARTBEAT that is due, if one is."""
        due = self.next_timeout()
        if due is None or now < due:
            return None
        self._asked_at = now
        self._questions = min(self._questions + 1, 8)
        self.counters.heartbeats += 1
        if self._next is None:
            return wire.heartbeat(0, 0, self.stream)
        first = next(iter(self._unacked))
        return wire.heartbeat(first, after(self._next, -1), self.stream)
