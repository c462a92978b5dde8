"""The far end of a tunnel: order, loss and latency of numbered messages. Pure.

Two strategies: `DropLate` gives each message on at once and discards those that come after newer ones; `HoldBack`
waits a short time for those that are missing. Loss is counted as RFC 3550 does it, from the numbers that were to be
expected; a number far outside the window, or another session, is a sender that began anew.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from dataclasses import dataclass
from typing import Generic, TypeVar

__all__ = ["Arrival", "DropLate", "HoldBack", "Reorder", "TunnelMeter", "TunnelTraffic"]

_REACH = 4096
Item = TypeVar("Item")


@dataclass(frozen=True, slots=True)
class Arrival(Generic[Item]):
    """A message that came out of a tunnel.

    Attributes:
        session: Of its sender.
        number: Of its sender's messages.
        item: The message.
    """

    session: int
    number: int
    item: Item


class Reorder(ABC, Generic[Item]):
    """Gives messages on in the order of their numbers.

    Attributes:
        late: Messages that came after newer ones.
        discarded: Messages not given on for that.
        duplicates: Messages that had come before.
        restarts: How often the sender began anew.
    """

    def __init__(self) -> None:
        self.late = self.discarded = self.duplicates = self.restarts = 0
        self._session: int | None = None

    def put(self, arrival: Arrival[Item], now_s: float) -> list[Item]:
        """A message came; those to give on now."""
        if arrival.session != self._session:
            left = [] if self._session is None else self.flush()
            self.restarts += self._session is not None
            self._session = arrival.session
            self._begin(arrival.number)
            return [*left, *self._put(arrival, now_s)]
        return self._put(arrival, now_s)

    @abstractmethod
    def _begin(self, number: int) -> None:
        """A sender begins."""

    @abstractmethod
    def _put(self, arrival: Arrival[Item], now_s: float) -> list[Item]:
        """A message of this sender."""

    def due(self, now_s: float) -> list[Item]:  # noqa: ARG002
        """Messages that have waited long enough."""
        return []

    def next_due_s(self) -> float | None:
        """When `due` will have something; None if nothing waits."""
        return None

    def flush(self) -> list[Item]:
        """Everything that waits."""
        return []


class DropLate(Reorder[Item]):
    """Newest first: what comes after a newer one is discarded."""

    def _begin(self, number: int) -> None:
        self._newest = number - 1
        self._seen: deque[int] = deque(maxlen=256)

    def _put(self, arrival: Arrival[Item], now_s: float) -> list[Item]:  # noqa: ARG002
        number = arrival.number
        if number in self._seen:
            self.duplicates += 1
            return []
        self._seen.append(number)
        if number <= self._newest:
            self.late += 1
            self.discarded += 1
            return []
        self._newest = number
        return [arrival.item]


class HoldBack(Reorder[Item]):
    """Waits for what is missing.

    Args:
        hold_s: At most so long.
        most: And while no more than so many wait.
    """

    def __init__(self, hold_s: float = 0.05, most: int = 256) -> None:
        super().__init__()
        self._hold_s = hold_s
        self._most = most
        self._waiting: dict[int, tuple[float, Item]] = {}

    def _begin(self, number: int) -> None:
        self._next = number
        self._newest = number - 1

    def _put(self, arrival: Arrival[Item], now_s: float) -> list[Item]:
        number = arrival.number
        if number in self._waiting:
            self.duplicates += 1
            return []
        if number < self._newest:
            self.late += 1
        if number < self._next:
            self.discarded += 1
            return []
        self._newest = max(self._newest, number)
        self._waiting[number] = (now_s, arrival.item)
        return self.due(now_s)

    def due(self, now_s: float) -> list[Item]:
        """What is in order, and what has waited long enough with what was before it."""
        ready: list[Item] = []
        while self._waiting:
            if self._next not in self._waiting:
                first = min(self._waiting)
                if now_s < self._waiting[first][0] + self._hold_s and (
                    len(self._waiting) <= self._most
                ):
                    break
                self._next = first
            ready.append(self._waiting.pop(self._next)[1])
            self._next += 1
        return ready

    def next_due_s(self) -> float | None:
        """When the message before the gap has waited long enough."""
        if not self._waiting:
            return None
        return self._waiting[min(self._waiting)][0] + self._hold_s

    def flush(self) -> list[Item]:
        """Everything that waits, in order."""
        ready = [self._waiting[number][1] for number in sorted(self._waiting)]
        self._waiting.clear()
        return ready


@dataclass(frozen=True, slots=True)
class TunnelTraffic:
    """What the far end saw within the window; counters are since the beginning.

    Attributes:
        latency_s: Mean.
        latency_p95_s: 95 % were faster.
        jitter_s: As RFC 3550.
        loss_rate: Lost on the network, 0..1.
        throttle_rate: Left out on purpose, 0..1.
        received: Messages.
        lost: Messages.
        throttled: Messages.
    """

    latency_s: float
    latency_p95_s: float
    jitter_s: float
    loss_rate: float
    throttle_rate: float
    received: int
    lost: int
    throttled: int


class TunnelMeter:
    """Measures latency and loss of one topic's tunnel.

    Args:
        window_s: How far it looks back.
    """

    def __init__(self, window_s: float = 5.0) -> None:
        self.received = self.throttled = 0
        self._window_s = window_s
        self._session: int | None = None
        self._first = self._highest = self._base_received = self._lost_before = 0
        self._throttled_then = 0
        self._jitter_s = self._transit_s = 0.0
        self._recent: deque[tuple[float, float, int, int, int]] = deque(maxlen=20_000)

    @property
    def lost(self) -> int:
        """Messages that were sent and did not come; those still on their way are among them."""
        if self._session is None:
            return 0
        expected = self._highest - self._first + 1
        return self._lost_before + max(0, expected - (self.received - self._base_received))

    def came(
        self, session: int, number: int, throttled: int, latency_s: float, now_s: float
    ) -> None:
        """A message came, for the first time."""
        if session != self._session or abs(number - self._highest) > _REACH:
            self._lost_before = self.lost
            self._session, self._first, self._highest = session, number, number
            self._base_received = self.received
            self._throttled_then = throttled
            self._transit_s = latency_s
        self.received += 1
        self._highest = max(self._highest, number)
        self.throttled += max(0, throttled - self._throttled_then)
        self._throttled_then = max(throttled, self._throttled_then)
        self._jitter_s += (abs(latency_s - self._transit_s) - self._jitter_s) / 16
        self._transit_s = latency_s
        self._recent.append((now_s, latency_s, self.received, self.lost, self.throttled))

    def traffic(self, now_s: float) -> TunnelTraffic:
        """What came lately."""
        while self._recent and self._recent[0][0] < now_s - self._window_s:
            self._recent.popleft()
        times = sorted(latency for _, latency, *_ in self._recent)
        if not times:
            counters = (self.received, self.lost, self.throttled)
            return TunnelTraffic(0.0, 0.0, self._jitter_s, 0.0, 0.0, *counters)
        _, _, received_then, lost_then, throttled_then = self._recent[0]
        came = self.received - received_then + 1
        lost = max(0, self.lost - lost_then)
        throttled = self.throttled - throttled_then
        return TunnelTraffic(
            sum(times) / len(times),
            times[min(len(times) - 1, int(0.95 * len(times)))],
            self._jitter_s,
            lost / (came + lost),
            throttled / (came + lost + throttled),
            self.received,
            self.lost,
            self.throttled,
        )
