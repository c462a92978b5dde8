"""Runs callbacks and timers in the threads that spin, and nowhere else.

`Executor.spin` sleeps until something arrives or a timer is due; it never polls. One thread takes
everything that is due in one go. With several threads, each takes one call at a time, and calls of one
mutually exclusive `CallbackGroup` never overlap.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from simple_ros.callbacks import CallbackGuard
from simple_ros.message_queue import CallbackGroup, MessageQueue
from simple_ros.schedule import TimerEvent, TimerSchedule

__all__ = ["Executor", "ScheduledCall"]

_EVENTS = "simple_ros/events"


class ScheduledCall:
    """A timer of an executor: a schedule, a callback, a group."""

    def __init__(
        self, schedule: TimerSchedule, callback: Callable[[Any], object], group: CallbackGroup
    ) -> None:
        self.schedule = schedule
        self.group = group
        self.guard = CallbackGuard(f"a timer of {schedule.period_s:g} s")
        self._callback = callback

    def call_if_due(self, now: float) -> bool:
        """Call if due at monotonic time ``now``; whether it was."""
        event = self.schedule.fire(now, time.time())
        if event is None:
            return False
        self.call(event)
        return True

    def call(self, event: TimerEvent) -> None:
        """Call with an event that was due."""
        begun = time.monotonic()
        self.guard.call(self._callback, event)
        ended = time.monotonic()
        self.schedule.called(ended, ended - begun)


class Executor:
    """Everything that waits for a thread that spins.

    Attributes:
        queue: Where messages wait.
    """

    def __init__(self) -> None:
        self.queue = MessageQueue(self._arrived)
        self._condition = threading.Condition()
        self._arrivals = 0
        self._timers: dict[ScheduledCall, None] = {}
        self._busy: set[CallbackGroup] = set()
        self._events = self.queue.add_subscriber(_EVENTS, lambda call: call(), depth=1000)
        self._stopped = False
        self._spinners: list[int] = []

    # -- what is to be done --------------------------------------------------------------------

    def _arrived(self) -> None:
        with self._condition:
            self._arrivals += 1
            self._condition.notify()

    def call_soon(self, function: Callable[[], object]) -> None:
        """Call in a thread that spins (events of publishers and subscriptions)."""
        self.queue.deliver(self._events, (function,))

    def add_timer(self, timer: ScheduledCall) -> None:
        """Call a timer when it is due."""
        with self._condition:
            self._timers[timer] = None
        self._arrived()

    def remove_timer(self, timer: ScheduledCall) -> None:
        """Forget a timer."""
        with self._condition:
            self._timers.pop(timer, None)

    def timers_changed(self) -> None:
        """A timer was started, stopped or given another period."""
        self._arrived()

    def _next_due(self) -> float | None:
        dues = [timer.schedule.due for timer in list(self._timers)]
        return min((due for due in dues if due is not None), default=None)

    # -- doing it ------------------------------------------------------------------------------

    @property
    def is_stopped(self) -> bool:
        """Whether `stop` was called."""
        return self._stopped

    def stop(self) -> None:
        """Let every spin return. May be called from a signal handler."""
        self._stopped = True
        # A signal handler may interrupt the very thread that holds the lock: wake from elsewhere.
        threading.Thread(target=self._wake_all, daemon=True).start()

    def _wake_all(self) -> None:
        with self._condition:
            self._condition.notify_all()

    def run_due(self) -> int:
        """Call everything that is due now; return how many calls that were."""
        now = time.monotonic()
        self._spinners.append(threading.get_ident())
        try:
            return self._run_due(now)
        finally:
            self._spinners.remove(threading.get_ident())

    def is_only_thread(self, thread: int) -> bool:
        """Whether that thread makes calls now and no other one does: what it waits for never comes."""
        return set(self._spinners) == {thread}

    def _run_due(self, now: float) -> int:
        calls = sum(timer.call_if_due(now) for timer in list(self._timers))
        return calls + self.queue.process_callbacks()

    def spin_once(self, timeout: float | None = 0.0) -> int:
        """Call everything that is due, waiting up to ``timeout`` seconds for the first of it.

        Args:
            timeout: Seconds; None waits until something is due.

        Returns:
            How many callbacks and timers were called.
        """
        end = None if timeout is None else time.monotonic() + timeout
        while not self._stopped:
            with self._condition:
                seen = self._arrivals
            calls = self.run_due()
            if calls or not self._wait(seen, end):
                return calls
        return 0

    def _wait(self, seen: int, end: float | None) -> bool:
        """Wait for an arrival since ``seen`` or a timer; False once ``end`` has come."""
        due = self._next_due()
        limits = [moment for moment in (due, end) if moment is not None]
        with self._condition:
            if self._arrivals == seen and not self._stopped:
                timeout = max(0.0, min(limits) - time.monotonic()) if limits else None
                self._condition.wait(timeout)
        return end is None or time.monotonic() < end

    def spin(self, threads: int = 1) -> None:
        """Call everything as it comes, until `stop`, in this thread and ``threads - 1`` others.

        Raises:
            ValueError: ``threads`` is less than 1.
        """
        if threads < 1:
            raise ValueError(f"spin needs at least 1 thread, not {threads}")
        if threads == 1:
            while not self._stopped:
                self.spin_once(None)
            return
        others = [
            threading.Thread(target=self._spin_shared, name=f"spin {index}", daemon=True)
            for index in range(1, threads)
        ]
        for thread in others:
            thread.start()
        self._spin_shared()
        for thread in others:
            thread.join()

    def _spin_shared(self) -> None:
        self._spinners.append(threading.get_ident())
        try:
            self._spin_until_stopped()
        finally:
            self._spinners.remove(threading.get_ident())

    def _spin_until_stopped(self) -> None:
        while not self._stopped:
            with self._condition:
                seen = self._arrivals
            if not self._do_one():
                self._wait(seen, None)

    def _do_one(self) -> bool:
        """Take one call whose group is free, and make it; False if there is none."""
        now = time.monotonic()
        with self._condition:
            job = self._claim(now)
        if job is None:
            return False
        group, call = job
        try:
            call()
        finally:
            if not group.reentrant:
                with self._condition:
                    self._busy.discard(group)
                    self._arrivals += 1
                    self._condition.notify()
        return True

    def _claim(self, now: float) -> tuple[CallbackGroup, Callable[[], object]] | None:
        for timer in self._timers:
            due = timer.schedule.due
            if due is not None and due <= now and self._enter(timer.group):
                event = timer.schedule.fire(now, time.time())
                if event is not None:
                    return timer.group, partial(timer.call, event)
        taken = self.queue.take_one(lambda token: self._is_free(token.group))
        if taken is None:
            return None
        token, message = taken
        self._enter(token.group)
        return token.group, partial(token.call, message)

    def _is_free(self, group: CallbackGroup) -> bool:
        return group.reentrant or group not in self._busy

    def _enter(self, group: CallbackGroup) -> bool:
        if not self._is_free(group):
            return False
        if not group.reentrant:
            self._busy.add(group)
        return True
