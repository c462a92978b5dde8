"""When a timer fires: pure state, time as an argument.

A periodic timer keeps its phase: it is due at whole periods after its start however long a callback
took. After a callback that took too long the timer fires once at once; further periods that passed
meanwhile are skipped, never caught up in a burst.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from simple_ros.errors import ConfigError

__all__ = ["RateSchedule", "TimerEvent", "TimerSchedule"]


class TimerEvent(NamedTuple):
    """What a timer callback is told. Times are seconds since 1970-01-01 UTC.

    Attributes:
        current_real: When the callback is called.
        last_real: When it was called before; 0.0 the first time.
        expected_real: When it should have been called.
        last_duration: Seconds the previous call took; 0.0 the first time.
        skipped: Whole periods passed over since the previous call.
    """

    current_real: float
    last_real: float
    expected_real: float
    last_duration: float
    skipped: int = 0


class TimerSchedule:
    """The state of one timer: stopped, running or paused.

    Args:
        period_s: Seconds between calls, more than 0.
        oneshot: Fire once per start.

    Raises:
        ConfigError: The period is not a positive number.
    """

    def __init__(self, period_s: float, *, oneshot: bool = False) -> None:
        self.oneshot = oneshot
        self._period_s = _checked(period_s)
        self._due: float | None = None
        self._remaining: float | None = None
        self._last_real = 0.0
        self._last_duration = 0.0
        self._skipped = 0

    @property
    def period_s(self) -> float:
        """Seconds between calls."""
        return self._period_s

    @property
    def due(self) -> float | None:
        """Monotonic time of the next call; None while stopped or paused."""
        return self._due

    @property
    def is_paused(self) -> bool:
        """Whether `resume` would go on."""
        return self._remaining is not None

    def start(self, now: float) -> None:
        """Run from now; no effect while running or paused."""
        if self._due is None and self._remaining is None:
            self._due = now + self._period_s

    def stop(self) -> None:
        """Stop; `start` begins anew."""
        self._due = self._remaining = None

    def pause(self, now: float) -> None:
        """Hold, if running."""
        if self._due is not None:
            self._remaining = max(0.0, self._due - now)
            self._due = None

    def resume(self, now: float) -> None:
        """Go on, if paused: a periodic timer with a full period, a one-shot with what was left."""
        if self._remaining is not None:
            self._due = now + (self._remaining if self.oneshot else self._period_s)
            self._remaining = None

    def set_period(self, period_s: float, now: float) -> None:
        """Change the period; a running timer starts over with it.

        Raises:
            ConfigError: The period is not a positive number.
        """
        self._period_s = _checked(period_s)
        if self._due is not None:
            self._due = now + self._period_s

    def fire(self, now: float, real: float) -> TimerEvent | None:
        """The event of a call that is due now, or None; the next call is scheduled.

        Args:
            now: Monotonic seconds.
            real: The same moment in seconds since 1970.
        """
        due = self._due
        if due is None or now < due:
            return None
        event = TimerEvent(
            real, self._last_real, real - (now - due), self._last_duration, self._skipped
        )
        self._last_real = real
        if self.oneshot:
            self._due = None
        else:
            self._due = due + self._period_s
        return event

    def called(self, now: float, duration_s: float) -> None:
        """The callback has returned at ``now`` after ``duration_s`` seconds."""
        self._last_duration = duration_s
        self._skipped = 0
        if self._due is not None and self._due <= now:
            self._skipped = math.floor((now - self._due) / self._period_s)
            self._due += self._skipped * self._period_s


def _checked(period_s: float) -> float:
    if not (period_s > 0 and math.isfinite(period_s)):
        raise ConfigError(f"a timer period is a positive number of seconds, not {period_s!r}")
    return float(period_s)


class RateSchedule:
    """When a loop that runs at a rate goes on.

    The phase is kept while the work fits the period. A loop that is late by more than a period, or whose
    clock went back, starts over: nothing is caught up.

    Args:
        hz: Turns a second, more than 0.
        now: Seconds on the loop's clock.

    Raises:
        ConfigError: The rate is not a positive number.
    """

    def __init__(self, hz: float, now: float) -> None:
        if not (hz > 0 and math.isfinite(hz)):
            raise ConfigError(f"a rate is a positive number of turns a second, not {hz!r}")
        self.period_s = 1.0 / hz
        self._started = now

    def turn_end(self, now: float) -> float:
        """When the present turn ends; the next begins then, or at once if that has passed."""
        if now < self._started:
            self._started = now
        end = self._started + self.period_s
        if now > end + self.period_s:
            self._started = now
            return now
        self._started = end
        return end

    def restart(self, now: float) -> None:
        """A new phase from now."""
        self._started = now
