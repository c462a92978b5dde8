"""Timers of the blocking face."""

from __future__ import annotations

import time
from collections.abc import Callable

from simple_ros.errors import HandleClosed
from simple_ros.executor import Executor, ScheduledCall
from simple_ros.message_queue import CallbackGroup
from simple_ros.schedule import TimerEvent, TimerSchedule

__all__ = ["Timer"]


class Timer:
    """Calls a callback in the thread that spins. Made by `NodeHandle.create_timer`."""

    def __init__(
        self,
        executor: Executor,
        schedule: TimerSchedule,
        callback: Callable[[TimerEvent], object],
        group: CallbackGroup,
    ) -> None:
        self._executor = executor
        self._schedule = schedule
        self._call = ScheduledCall(schedule, callback, group)
        self._closed = False
        executor.add_timer(self._call)

    @property
    def period(self) -> float:
        """Seconds between calls; a running timer starts over when it is set."""
        return self._schedule.period_s

    @period.setter
    def period(self, period_s: float) -> None:
        self._schedule.set_period(period_s, time.monotonic())
        self._executor.timers_changed()

    @property
    def is_running(self) -> bool:
        """Whether a call is due some time."""
        return self._schedule.due is not None

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
        self._schedule.start(time.monotonic())
        self._executor.timers_changed()

    def stop(self) -> None:
        """Stop; `start` begins anew."""
        self._schedule.stop()

    def pause(self) -> None:
        """Hold; `resume` goes on."""
        self._schedule.pause(time.monotonic())

    def resume(self) -> None:
        """Go on: a periodic timer with a full period, a one-shot with what was left."""
        if not self._closed:
            self._schedule.resume(time.monotonic())
            self._executor.timers_changed()

    def set_one_shot(self, oneshot: bool) -> None:
        """Whether to stop after the next call."""
        self._schedule.oneshot = oneshot

    def close(self) -> None:
        """Stop for good."""
        self._closed = True
        self._schedule.stop()
        self._executor.remove_timer(self._call)
