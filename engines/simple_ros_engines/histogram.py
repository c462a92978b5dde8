"""How often a time fell between bounds, at the cost of one search for each: pure."""

from __future__ import annotations

from bisect import bisect_left

__all__ = ["BOUNDS_MS", "Histogram"]

BOUNDS_MS = tuple(
    round(scale * step, 6) for scale in (0.01, 0.1, 1.0, 10.0, 100.0) for step in (1, 2, 5)
)
"""Upper bounds, 0.01 ms to 500 ms, three a decade."""


class Histogram:
    """Times since the start.

    Attributes:
        counts: By bound; the last of what lies above them all.
        count: Of all.
        total_ms: Their sum.
        largest_ms: Of all.
    """

    __slots__ = ("count", "counts", "largest_ms", "total_ms")

    def __init__(self) -> None:
        self.counts = [0] * (len(BOUNDS_MS) + 1)
        self.count = 0
        self.total_ms = 0.0
        self.largest_ms = 0.0

    def add(self, time_ms: float) -> None:
        """A time."""
        self.counts[bisect_left(BOUNDS_MS, time_ms)] += 1
        self.count += 1
        self.total_ms += time_ms
        self.largest_ms = max(self.largest_ms, time_ms)

    def mean_ms(self) -> float:
        """Mean; 0 while there are none."""
        return self.total_ms / self.count if self.count else 0.0

    def quantile_ms(self, share: float) -> float:
        """Time below which a share lies, between bounds by a line; 0 while there are none."""
        wanted, below = share * self.count, 0
        for index, count in enumerate(self.counts):
            if count and below + count >= wanted:
                low = BOUNDS_MS[index - 1] if index else 0.0
                high = BOUNDS_MS[index] if index < len(BOUNDS_MS) else self.largest_ms
                found = low + (high - low) * (wanted - below) / count
                return min(found, self.largest_ms)
            below += count
        return 0.0
