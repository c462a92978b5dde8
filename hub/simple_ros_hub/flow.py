"""What is sent over a narrow link: by rate, by budget, by priority, by age. Pure."""

from __future__ import annotations

import heapq
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from simple_ros.errors import ConfigError

__all__ = ["PriorityGate", "TokenBucket"]

Item = TypeVar("Item")


class TokenBucket:
    """At most so many units a second, with bursts.

    Args:
        rate: Units a second; 0 for no limit.
        burst: Units that may go at once after a silence.
        now_s: When it begins, full.

    Raises:
        ConfigError: A number is negative.
    """

    def __init__(self, rate: float, burst: float, now_s: float) -> None:
        if rate < 0 or burst < 0:
            raise ConfigError("a rate and a burst cannot be negative")
        self._rate = rate
        self._burst = burst
        self._tokens = burst
        self._at_s = now_s

    @property
    def rate(self) -> float:
        """Units a second; 0 for no limit."""
        return self._rate

    def set_rate(self, rate: float, burst: float, now_s: float) -> None:
        """From now on; a bucket that had no limit is full then."""
        self._refill(now_s)
        self._tokens = min(self._tokens, burst) if self._rate else burst
        self._rate, self._burst = rate, burst

    def takes(self, units: float, now_s: float) -> bool:
        """Whether so many may go now; then they are counted.

        More than a burst at once goes when the bucket is full, and is paid off afterwards.
        """
        if not self._rate:
            return True
        self._refill(now_s)
        if self._tokens < min(units, self._burst):
            return False
        self._tokens -= units
        return True

    def wait_s(self, units: float, now_s: float) -> float:
        """How long until so many may go."""
        if not self._rate:
            return 0.0
        self._refill(now_s)
        return max(0.0, (min(units, self._burst) - self._tokens) / self._rate)

    def _refill(self, now_s: float) -> None:
        self._tokens = min(self._burst, self._tokens + self._rate * max(0.0, now_s - self._at_s))
        self._at_s = max(self._at_s, now_s)


@dataclass(order=True, slots=True)
class _Waiting(Generic[Item]):
    rank: tuple[int, int]
    until_s: float = field(compare=False)
    size: int = field(compare=False)
    item: Item = field(compare=False)


class PriorityGate(Generic[Item]):
    """A queue before a bucket: the highest priority goes first, what is too old falls.

    When it is full the lowest priority falls, of those the newest.

    Args:
        bucket: The budget, in bytes.
        limit: Items that may wait.

    Attributes:
        expired: Items that became too old.
        overflowed: Items that found no place.
    """

    def __init__(self, bucket: TokenBucket, limit: int = 100) -> None:
        if limit < 1:
            raise ConfigError("a queue needs a place")
        self.bucket = bucket
        self.expired = 0
        self.overflowed = 0
        self._limit = limit
        self._heap: list[_Waiting[Item]] = []
        self._count = 0

    def __len__(self) -> int:
        return len(self._heap)

    def put(self, item: Item, size: int, priority: int, until_s: float) -> None:
        """Something is to be sent.

        Args:
            item: It.
            size: Bytes.
            priority: Higher goes first.
            until_s: When it is of no use any more.
        """
        self._count += 1
        heapq.heappush(self._heap, _Waiting((-priority, self._count), until_s, size, item))
        if len(self._heap) > self._limit:
            worst = max(range(len(self._heap)), key=lambda index: self._heap[index].rank)
            self._heap[worst] = self._heap[-1]
            self._heap.pop()
            heapq.heapify(self._heap)
            self.overflowed += 1

    def take(self, now_s: float) -> list[Item]:
        """What may be sent now, in order."""
        sent = []
        while self._heap:
            first = self._heap[0]
            if first.until_s < now_s:
                heapq.heappop(self._heap)
                self.expired += 1
            elif self.bucket.takes(first.size, now_s):
                sent.append(heapq.heappop(self._heap).item)
            else:
                break
        return sent

    def wait_s(self, now_s: float) -> float | None:
        """Seconds until the next item may go; None if none waits."""
        if not self._heap:
            return None
        return self.bucket.wait_s(self._heap[0].size, now_s)
