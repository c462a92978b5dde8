"""How long something took, since the last look."""

from __future__ import annotations

import bisect
from dataclasses import dataclass

__all__ = ["Latency", "LatencyFacts"]

_KEPT = 4096
_BUDGET_S = 0.001


@dataclass(frozen=True)
class LatencyFacts:
    """Durations in seconds; all 0 if there was nothing.

    Attributes:
        mean: Of all.
        p99: Of 100, 99 took no longer.
        worst: The longest.
        count: How many there were.
        late: How many took longer than a millisecond, which is what the agent may add to a sample's way.
    """

    mean: float = 0.0
    p99: float = 0.0
    worst: float = 0.0
    count: int = 0
    late: int = 0


class Latency:
    """Some durations in seconds; of very many the first 4096 count."""

    def __init__(self) -> None:
        self._values: list[float] = []

    def add(self, seconds: float) -> None:
        """One more."""
        if len(self._values) < _KEPT:
            self._values.append(seconds)

    def take(self) -> LatencyFacts:
        """What they were since the last call."""
        values, self._values = sorted(self._values), []
        if not values:
            return LatencyFacts()
        p99 = values[min(len(values) - 1, len(values) * 99 // 100)]
        late = len(values) - bisect.bisect_right(values, _BUDGET_S)
        return LatencyFacts(sum(values) / len(values), p99, values[-1], len(values), late)
