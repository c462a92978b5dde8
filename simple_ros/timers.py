"""Timers on the event loop."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import TYPE_CHECKING, Any

from simple_ros.callbacks import CALLBACK_ERRORS, CallbackGuard, is_async, is_being_cancelled
from simple_ros.clock import Clock
from simple_ros.errors import HandleClosed
from simple_ros.schedule import TimerEvent, TimerSchedule
from simple_ros.sim_time import ClockChange

if TYPE_CHECKING:
    from simple_ros.node import NodeHandle

__all__ = ["Timer", "TimerCallback"]

TimerCallback = Callable[[TimerEvent], None] | Callable[[TimerEvent], Coroutine[Any, Any, None]]


class Timer:
    """Calls a callback periodically, or once. Made by `NodeHandle.create_timer`.

    A coroutine callback never overlaps itself: while it runs, periods are skipped. It goes by the node's
    clock: with simulated time it stands while ``/clock`` pauses, and starts over with a full period when
    that goes back.
    """

    def __init__(self, node: NodeHandle, schedule: TimerSchedule, callback: TimerCallback) -> None:
        self._node = node
        self._schedule = schedule
        self._callback = callback
        self._is_async = is_async(callback)
        self._guard = CallbackGuard(f"a timer of {schedule.period_s:g} s")
        self._loop = asyncio.get_running_loop()
        self._clock = Clock.attach(node)
        self._clock.add_listener(self._clock_changed)
        self._handle: asyncio.Handle | None = None
        self._task: asyncio.Task[None] | None = None
        self._closed = False

    @property
    def period(self) -> float:
        """Seconds between calls; a running timer starts over when it is set."""
        return self._schedule.period_s

    @period.setter
    def period(self, period_s: float) -> None:
        self._schedule.set_period(period_s, self._now())
        self._arm()

    @property
    def is_running(self) -> bool:
        """Whether a call is due some time."""
        return self._schedule.due is not None

    @property
    def errors(self) -> int:
        """Exceptions of the callback so far."""
        return self._guard.errors

    def start(self) -> None:
        """Run from now; no effect while running or paused.

        Raises:
            HandleClosed: The timer is closed.
        """
        if self._closed:
            raise HandleClosed("timer")
        self._schedule.start(self._now())
        self._arm()

    def stop(self) -> None:
        """Stop; `start` begins anew."""
        self._schedule.stop()
        self._arm()

    def pause(self) -> None:
        """Hold; `resume` goes on."""
        self._schedule.pause(self._now())
        self._arm()

    def resume(self) -> None:
        """Go on: a periodic timer with a full period, a one-shot with what was left."""
        if not self._closed:
            self._schedule.resume(self._now())
            self._arm()

    def set_one_shot(self, oneshot: bool) -> None:
        """Whether to stop after the next call."""
        self._schedule.oneshot = oneshot

    def close(self) -> None:
        """Stop for good."""
        self.close_sparing(asyncio.current_task(self._loop))

    def close_sparing(self, caller: asyncio.Task[Any] | None) -> None:
        """Stop for good; a coroutine callback under way is cancelled, unless it is the caller."""
        self._closed = True
        self._clock.remove_listener(self._clock_changed)
        self.stop()
        if self._task is not None and self._task is not caller:
            self._task.cancel()
        self._node.forget_timer(self)

    def _now(self) -> float:
        return self._clock.monotonic() if self._clock.is_sim else self._loop.time()

    def _clock_changed(self, change: ClockChange) -> None:
        if change.breaks and self.is_running:
            # What was due in the time that is gone says nothing about this one.
            self._schedule.set_period(self._schedule.period_s, self._now())
            self._arm()
        elif self._clock.is_sim and self._handle is None and self._task is None:
            # At once: a simulator may be several steps ahead of what the loop does next.
            due = self._schedule.due
            if due is not None and self._clock.has_come(due):
                self._ring()

    def _arm(self) -> None:
        if self._handle is not None:
            self._handle.cancel()
            self._handle = None
        due = self._schedule.due
        if due is None or self._closed:
            return
        if not self._clock.is_sim:
            self._handle = self._loop.call_at(due, self._ring)
        elif self._clock.has_come(due) and self._task is None:
            self._handle = self._loop.call_soon(self._ring)

    def _ring(self) -> None:
        self._handle = None
        due = self._schedule.due
        if self._task is not None or due is None:
            return
        # The loop may call up to one clock tick early.
        now = max(self._now(), due)
        event = self._schedule.fire(now, self._clock.now().seconds)
        if event is None:
            return
        if self._is_async:
            self._task = self._loop.create_task(self._await_callback(event))
            return
        begun = self._loop.time()
        self._guard.call(self._callback, event)
        self._called(begun)

    async def _await_callback(self, event: TimerEvent) -> None:
        begun = self._loop.time()
        try:
            await self._callback(event)  # type: ignore[misc]
        except CALLBACK_ERRORS as error:
            if is_being_cancelled():
                raise
            self._guard.failed(error)
        finally:
            self._task = None
            self._called(begun)

    def _called(self, begun: float) -> None:
        self._schedule.called(self._now(), self._loop.time() - begun)
        if self._handle is None:
            self._arm()
