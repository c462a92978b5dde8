"""How often something happens: pure, time as an argument."""

from __future__ import annotations

from collections import deque

__all__ = ["RateMeter"]


class RateMeter:
    """Counts messages and measures their rate over the last seconds.

    Args:
        window_s: How far back the rates look.
        silent_after_s: With nothing for so long, the rates are zero.

    Attributes:
        messages: Messages so far.
    """

    def __init__(self, window_s: float = 2.0, silent_after_s: float = 1.0) -> None:
        self.messages = 0
        self._window_s = window_s
        self._silent_after_s = silent_after_s
        self._recent: deque[tuple[float, int]] = deque()
        self._recent_bytes = 0

    def note(self, now: float, size_bytes: int) -> None:
        """A message of that size came."""
        self.messages += 1
        self._recent.append((now, size_bytes))
        self._recent_bytes += size_bytes
        while self._recent[0][0] < now - self._window_s:
            self._recent_bytes -= self._recent.popleft()[1]

    def rate_hz(self, now: float) -> float:
        """Messages per second."""
        span_s = self._span_s(now)
        return (len(self._recent) - 1) / span_s if span_s else 0.0

    def bytes_per_s(self, now: float) -> float:
        """Bytes per second."""
        span_s = self._span_s(now)
        return (self._recent_bytes - self._recent[0][1]) / span_s if span_s else 0.0

    def _span_s(self, now: float) -> float:
        """From the first to the last message in the window; 0 if there are no two, or silence."""
        if len(self._recent) < 2 or now - self._recent[-1][0] > self._silent_after_s:
            return 0.0
        return self._recent[-1][0] - self._recent[0][0]
