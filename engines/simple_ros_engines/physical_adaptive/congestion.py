"""Whether a queue is about to fill: pure.

A link is congested when bytes wait longer than the path alone takes. Two signs must agree, so that a first
byte in an empty buffer, or a single late packet, is none: the buffer grows (mean of the last 3 of 10
samples over 1.5 times the mean of the 7 before), and the round trip is longer than both 1.3 times its mean
before and its minimum by some milliseconds (bufferbloat). One sign alone must last.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

__all__ = ["CongestionSettings", "CongestionWatch", "prevent"]


@dataclass(frozen=True, slots=True)
class CongestionSettings:
    """Thresholds.

    Attributes:
        buffer_growth: Ratio of recent to earlier buffer.
        rtt_growth: Ratio of recent to earlier round trip.
        floor_bytes: A smaller buffer is never congestion.
        floor_ms: Nor is a round trip less than this above its minimum.
        confirmations: Samples in a row that one sign alone needs.
        release: Calm samples in a row that end it.
    """

    buffer_growth: float = 1.5
    rtt_growth: float = 1.3
    floor_bytes: float = 4096.0
    floor_ms: float = 30.0
    confirmations: int = 4
    release: int = 5


class CongestionWatch:
    """Watches one link.

    Args:
        settings: Thresholds.
    """

    def __init__(self, settings: CongestionSettings | None = None) -> None:
        self.is_congested = False
        self._settings = settings or CongestionSettings()
        self._buffers: deque[float] = deque(maxlen=10)
        self._rtts: deque[float] = deque(maxlen=10)
        self._min_rtt: deque[float] = deque(maxlen=300)
        self._alone = 0
        self._calm = 0

    def sample(self, buffer_bytes: float | None, rtt_ms: float | None) -> bool:
        """Take a sample; what was not measured is None. Tells whether the link congests."""
        if buffer_bytes is not None:
            self._buffers.append(buffer_bytes)
        if rtt_ms is not None:
            self._rtts.append(rtt_ms)
            self._min_rtt.append(rtt_ms)
        signs = self._buffer_grows() + self._rtt_grows()
        self._alone = self._alone + 1 if signs else 0
        if signs == 2 or self._alone >= self._settings.confirmations:
            self.is_congested, self._calm = True, 0
        elif self.is_congested:
            self._calm += 1
            self.is_congested = self._calm < self._settings.release or self._still_waits()
        return self.is_congested

    def _still_waits(self) -> bool:
        if not self._rtts:
            return False
        above = self._rtts[-1] - min(self._min_rtt)
        return above > self._settings.floor_ms

    def _buffer_grows(self) -> bool:
        recent, earlier = _halves(self._buffers)
        settings = self._settings
        return recent > settings.floor_bytes and recent > settings.buffer_growth * earlier

    def _rtt_grows(self) -> bool:
        recent, earlier = _halves(self._rtts)
        if not recent:
            return False
        settings = self._settings
        above_least = recent - min(self._min_rtt)
        return recent > settings.rtt_growth * earlier and above_least > settings.floor_ms


def _halves(samples: deque[float]) -> tuple[float, float]:
    """Means of the last three and of the seven before; zeros until there are ten."""
    if len(samples) < 10:
        return 0.0, 0.0
    values = list(samples)
    return sum(values[7:]) / 3, sum(values[:7]) / 7


def prevent(compression_ratio: float, priority: int) -> tuple[float, int]:
    """What to do before a queue fills: send less (a smaller ratio), one priority lower."""
    return max(0.05, compression_ratio / 1.2), max(1, priority - 1)
