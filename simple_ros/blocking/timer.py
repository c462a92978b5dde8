"""Timers of the blocking face."""

from __future__ import annotations

import time
from collections.abc import Callable

from simple_ros.clock import Clock
from simple_ros.errors import HandleClosed
from simple_ros.executor import Executor, ScheduledCall
from simple_ros.message_queue import CallbackGroup
from simple_ros.schedule import TimerEvent, TimerSchedule
from simple_ros.sim_time import ClockChange

__all__ = ["Timer"]


class _ClockedSchedule(TimerSchedule):
    """A schedule that runs by a node's clock, for an executor that runs by the computer's.

    With simulated time a call is due at once or not at all, and the moments the executor gives are
    replaced. A clock that went back is noticed by the thread that spins, so nobody else changes the
    schedule. Without a clock it is a plain schedule.
    """

    def __init__(self, schedule: TimerSchedule, clock: Clock | None) -> None:
        super().__init__(schedule.period_s, oneshot=schedule.oneshot)
        self._clock = clock
        self._epoch = 0 if clock is None else clock.epoch

    def now(self) -> float:
        """The moment, as `start` and its like take it."""
        return time.monotonic() if self._clock is None else self._clock.monotonic()

    @property
    def is_running(self) -> bool:
        """Whether a call is due some time."""
        return self._due is not None

    def concerns_executor(self, clock: Clock) -> bool:
        """Whether it should look, after a change of the clock: a call is due, or all starts over."""
        due = self._due
        return due is not None and (clock.epoch != self._epoch or clock.has_come(due))

    @property
    def due(self) -> float | None:
        """Monotonic time of the next call; None while stopped, paused or not yet due by ``/clock``."""
        clock = self._clock
        if clock is None or self._due is None:
            return self._due
        self._start_over_if_broken(clock)
        if not clock.is_sim:
            return self._due
        return time.monotonic() if clock.has_come(self._due) else None

    def _start_over_if_broken(self, clock: Clock) -> None:
        if self._epoch != clock.epoch:
            self._epoch = clock.epoch
            self.set_period(self.period_s, clock.monotonic())

    def fire(self, now: float, real: float) -> TimerEvent | None:
        """The event of a call that is due now, or None; the next call is scheduled."""
        clock = self._clock
        if clock is None or not clock.is_sim:
            return super().fire(now, real)
        if self.due is None or self._due is None:
            return None
        return super().fire(max(clock.monotonic(), self._due), clock.now().seconds)

    def called(self, now: float, duration_s: float) -> None:
        """The callback has returned at ``now`` after ``duration_s`` seconds."""
        in_sim = self._clock is not None and self._clock.is_sim
        super().called(self.now() if in_sim else now, duration_s)


class Timer:
    """Calls a callback in the thread that spins. Made by `NodeHandle.create_timer`.

    It goes by the node's clock: with simulated time it stands while ``/clock`` pauses, and starts over
    with a full period when that goes back.
    """

    def __init__(
        self,
        executor: Executor,
        schedule: TimerSchedule,
        callback: Callable[[TimerEvent], object],
        group: CallbackGroup,
        clock: Clock | None = None,
    ) -> None:
        self._executor = executor
        self._schedule = _ClockedSchedule(schedule, clock)
        self._call = ScheduledCall(self._schedule, callback, group)
        self._clock = clock
        self._closed = False
        if clock is not None:
            clock.add_listener(self._clock_changed)
        executor.add_timer(self._call)

    @property
    def period(self) -> float:
        """Seconds between calls; a running timer starts over when it is set."""
        return self._schedule.period_s

    @period.setter
    def period(self, period_s: float) -> None:
        self._schedule.set_period(period_s, self._schedule.now())
        self._executor.timers_changed()

    @property
    def is_running(self) -> bool:
        """Whether a call is due some time."""
        return self._schedule.is_running

    @property
    def errors(self) -> int:
        """Exceptions of the callback so far."""
        return self._call.guard.errors

    def start(self) -> None:
        """Run from now; no effect while running or paused.

        Raises:
            HandleClosed: The timer is closed.
        """
        if self._closed:
            raise HandleClosed("timer")
        self._schedule.start(self._schedule.now())
        self._executor.timers_changed()

    def stop(self) -> None:
        """Stop; `start` begins anew."""
        self._schedule.stop()

    def pause(self) -> None:
        """Hold; `resume` goes on."""
        self._schedule.pause(self._schedule.now())

    def resume(self) -> None:
        """Go on: a periodic timer with a full period, a one-shot with what was left."""
        if not self._closed:
            self._schedule.resume(self._schedule.now())
            self._executor.timers_changed()

    def set_one_shot(self, oneshot: bool) -> None:
        """Whether to stop after the next call."""
        self._schedule.oneshot = oneshot

    def close(self) -> None:
        """Stop for good."""
        self._closed = True
        if self._clock is not None:
            self._clock.remove_listener(self._clock_changed)
        self._schedule.stop()
        self._executor.remove_timer(self._call)

    def _clock_changed(self, change: ClockChange) -> None:  # noqa: ARG002
        """On the loop's thread: let the executor look if there is something for it."""
        if self._clock is not None and self._schedule.concerns_executor(self._clock):
            self._executor.timers_changed()
