"""What a topic sends, over a time window: rate, bandwidth, jitter, burst. Pure."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from itertools import pairwise

from simple_ros.errors import ConfigError

__all__ = ["FlowMeter", "Traffic"]

MIN_WINDOW_S, MAX_WINDOW_S = 2.0, 10.0
_MOST = 20_000
_SAME_S = 1e-6


@dataclass(frozen=True, slots=True)
class Traffic:
    """What was sent within the window.

    Attributes:
        duration_s: The time that all this is about: the window, or since the topic began to send, if that is
            shorter. Above 10,000 messages a second it is told from the newest 20,000.
        messages: Counted.
        bytes: Counted.
        rate_hz: Messages a second, from the times between them.
        bandwidth: Bytes a second.
        delta_s: Mean time between two.
        jitter_s: Standard deviation of that.
    """

    duration_s: float = 0.0
    messages: int = 0
    bytes: int = 0
    rate_hz: float = 0.0
    bandwidth: float = 0.0
    delta_s: float = 0.0
    jitter_s: float = 0.0


class FlowMeter:
    """Counts a topic's messages.

    Args:
        window_s: How far it looks back, 2 to 10 s.

    Attributes:
        messages: Since the beginning.
        bytes: Since the beginning.

    Raises:
        ConfigError: The window is out of range.
    """

    def __init__(self, window_s: float = 5.0) -> None:
        if not MIN_WINDOW_S <= window_s <= MAX_WINDOW_S:
            raise ConfigError(
                f"window_s must be {MIN_WINDOW_S:g} to {MAX_WINDOW_S:g}, not {window_s:g}"
            )
        self.messages = 0
        self.bytes = 0
        self._window_s = window_s
        self._recent: deque[tuple[float, int]] = deque(maxlen=_MOST)
        self._since_s = 0.0

    def sent(self, size: int, now_s: float) -> None:
        """A message went out."""
        self._forget(now_s)
        if not self._recent:
            self._since_s = now_s
        self.messages += 1
        self.bytes += size
        self._recent.append((now_s, size))

    def traffic(self, now_s: float) -> Traffic:
        """What was sent lately."""
        self._forget(now_s)
        recent = self._recent
        if not recent:
            return Traffic()
        count, total = len(recent), sum(size for _, size in recent)
        span_s, duration_s = recent[-1][0] - recent[0][0], self._duration_s(now_s)
        if count < 2 or span_s <= 0:
            return Traffic(duration_s, count, total)
        delta_s = span_s / (count - 1)
        # A topic that has become silent has no rate any more, whatever its last burst had.
        quiet_s = now_s - recent[-1][0]
        rate_hz = (count - 1) / (span_s + max(0.0, quiet_s - delta_s))
        bandwidth = (total / count) * rate_hz
        return Traffic(
            duration_s, count, total, rate_hz, bandwidth, delta_s, self._jitter_s(delta_s)
        )

    def burst(self, span_s: float) -> int:
        """Most bytes within any time so long."""
        most = held = 0
        first = 0
        recent = tuple(self._recent)
        for now_s, size in recent:
            held += size
            while recent[first][0] <= now_s - span_s + _SAME_S:
                held -= recent[first][1]
                first += 1
            most = max(most, held)
        return most

    def _jitter_s(self, mean_s: float) -> float:
        times = [moment for moment, _ in self._recent]
        squares = [(b - a - mean_s) ** 2 for a, b in pairwise(times)]
        return math.sqrt(sum(squares) / len(squares))

    def _duration_s(self, now_s: float) -> float:
        """A window is whole once the topic has sent for so long, wherever its messages fall in it."""
        return min(self._window_s, now_s - self._since_s)

    def _forget(self, now_s: float) -> None:
        while self._recent and self._recent[0][0] < now_s - self._window_s:
            self._recent.popleft()
