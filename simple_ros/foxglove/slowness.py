"""Telling a client that it is too slow: at once, then rarely, and when it is over. Pure."""

from __future__ import annotations

from simple_ros.foxglove import frames
from simple_ros.foxglove.frames import Level

__all__ = ["BUFFER_FULL", "SlowNotice"]

BUFFER_FULL = "Send buffer limit reached"
"""Apps know this text and add advice of their own, so it never changes."""
_ID = "slow-client"
_PERIOD_S = 2.5
_CALM_S = 5.0


class SlowNotice:
    """Decides what a client is told about messages that fell."""

    def __init__(self) -> None:
        self._told_at: float | None = None
        self._dropped_at: float | None = None

    def dropped(self, now: float) -> str | None:
        """Messages fell; the frame to send, if it is time for one. Times in monotonic seconds."""
        self._dropped_at = now
        if self._told_at is not None and now - self._told_at < _PERIOD_S:
            return None
        self._told_at = now
        return frames.status(Level.WARNING, BUFFER_FULL, _ID)

    def tick(self, now: float) -> str | None:
        """Some time passed; the frame that takes the notice back, once nothing fell for 5 s."""
        if self._dropped_at is None or now - self._dropped_at < _CALM_S:
            return None
        self._dropped_at = self._told_at = None
        return frames.remove_status(_ID)
