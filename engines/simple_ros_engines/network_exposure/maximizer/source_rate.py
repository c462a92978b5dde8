"""How often an application sends while a throttle leaves messages out: from counters that count all. Pure."""

from __future__ import annotations

from collections import deque

__all__ = ["SourceRate"]


class SourceRate:
    """The rate before the throttle.

    Args:
        window_s: Over so long.
    """

    def __init__(self, window_s: float = 3.5) -> None:
        self._window_s = window_s
        self._seen: deque[tuple[float, int]] = deque()

    def counted(self, messages: int, now_s: float) -> float:
        """Messages a second; 0 while too little is known.

        Args:
            messages: Since the relay took the topic up: sent, left out and held.
            now_s: The time.
        """
        if self._seen and (messages < self._seen[-1][1] or now_s <= self._seen[-1][0]):
            self._seen.clear()  # another relay, which counts anew
        self._seen.append((now_s, messages))
        while len(self._seen) > 2 and self._seen[1][0] <= now_s - self._window_s:
            self._seen.popleft()
        began_s, before = self._seen[0]
        span_s = now_s - began_s
        return (messages - before) / span_s if span_s >= self._window_s else 0.0
