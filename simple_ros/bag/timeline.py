"""Playing back: when each message is due. Pure: time is an argument.

The bag's time runs along the monotonic clock, faster or slower by ``rate``. Pausing, stepping and
seeking move the point at which both are tied together.
"""

from __future__ import annotations

import math

from simple_ros.errors import ConfigError

__all__ = ["Timeline"]

_NS = 1e9


class Timeline:
    """The bag's time as a function of the monotonic clock.

    Args:
        start_ns: Bag time at ``now``.
        now: Monotonic seconds.
        rate: Bag seconds per second.
        paused: Whether to begin paused.

    Raises:
        ConfigError: The rate is not a positive number.
    """

    def __init__(
        self, start_ns: int, now: float, *, rate: float = 1.0, paused: bool = False
    ) -> None:
        self._rate = _checked(rate)
        self._anchor_ns = start_ns
        self._anchor_s = now
        self._paused = paused

    @property
    def rate(self) -> float:
        """Bag seconds per second while it runs."""
        return self._rate

    @property
    def is_paused(self) -> bool:
        """Whether bag time stands still."""
        return self._paused

    def position_ns(self, now: float) -> int:
        """Bag time at a moment of the monotonic clock."""
        if self._paused:
            return self._anchor_ns
        return self._anchor_ns + round((now - self._anchor_s) * self._rate * _NS)

    def due(self, stamp_ns: int) -> float:
        """The monotonic time at which a bag time is reached; infinite while paused."""
        if self._paused:
            return math.inf
        return self._anchor_s + (stamp_ns - self._anchor_ns) / _NS / self._rate

    def pause(self, now: float) -> None:
        """Let bag time stand still."""
        self.seek(self.position_ns(now), now)
        self._paused = True

    def resume(self, now: float) -> None:
        """Let it go on, from where it stands."""
        if self._paused:
            self._anchor_s = now
            self._paused = False

    def set_rate(self, rate: float, now: float) -> None:
        """Let it run faster or slower from now on.

        Raises:
            ConfigError: The rate is not a positive number.
        """
        checked = _checked(rate)
        self.seek(self.position_ns(now), now)
        self._rate = checked

    def seek(self, stamp_ns: int, now: float) -> None:
        """Bag time is ``stamp_ns`` now."""
        self._anchor_ns = stamp_ns
        self._anchor_s = now


def _checked(rate: float) -> float:
    if not (rate > 0 and math.isfinite(rate)):
        raise ConfigError(f"a playback rate is a positive number, not {rate!r}")
    return float(rate)
