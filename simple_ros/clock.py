"""The clock of a node: the computer's, or what ``/clock`` says.

Timers, rates and stamps of a node go by its `Clock`. With simulated time they move only when a
``rosgraph_msgs.Clock`` arrives: they stand while it pauses, and start over when it goes back.
"""

from __future__ import annotations

import asyncio
import logging
import os
import time
import weakref
from collections.abc import Callable
from typing import TYPE_CHECKING

from simple_ros.errors import HandleClosed, SimpleRosError
from simple_ros.msg.rosgraph_msgs import Clock as ClockMsg
from simple_ros.qos import QosProfile, Reliability
from simple_ros.schedule import RateSchedule
from simple_ros.sim_time import ClockChange, SimTime, wants_sim_time
from simple_ros.time import ClockType, ClockTypeMismatch, Duration, Time

if TYPE_CHECKING:
    from simple_ros.node import NodeHandle

__all__ = ["CLOCK_QOS", "CLOCK_TOPIC", "USE_SIM_TIME", "Clock", "ClockListener", "Rate"]

logger = logging.getLogger(__name__)

CLOCK_TOPIC = "/clock"
CLOCK_QOS = QosProfile(depth=1, reliability=Reliability.BEST_EFFORT)
USE_SIM_TIME = "SIMPLE_ROS_USE_SIM_TIME"

ClockListener = Callable[[ClockChange], None]

_WARN_AFTER_S = 5.0
# Simulators step in fractions that floats cannot hold; a timer due within this is due.
_SLACK_S = 1e-6

_clocks: weakref.WeakKeyDictionary[NodeHandle, Clock] = weakref.WeakKeyDictionary()


class Clock:
    """What time it is for a node. Use `Clock.attach`.

    Everything but `now`, `monotonic` and `is_sim` belongs to the node's event loop.

    Attributes:
        epoch: Counts up whenever times of before mean nothing any more: time went back, or simulated
            time was switched on or off.
    """

    def __init__(self, node: NodeHandle, *, sim: bool = False) -> None:
        self.epoch = 0
        self._node = weakref.ref(node)
        self._name = node.name
        self._is_sim = sim
        self._sim = SimTime()
        self._listeners: dict[ClockListener, None] = {}
        self._moved: asyncio.Future[None] | None = None
        self._follower: asyncio.Task[None] | None = None
        self._leaving: set[asyncio.Task[None]] = set()
        self._warning: asyncio.TimerHandle | None = None
        self._ended = False
        self._told_bad = False

    @classmethod
    def attach(cls, node: NodeHandle) -> Clock:
        """The clock of a node, made the first time.

        It begins with simulated time if ``SIMPLE_ROS_USE_SIM_TIME`` says so, and follows ``/clock`` from
        the first call with a started node on.

        Raises:
            ConfigError: ``SIMPLE_ROS_USE_SIM_TIME`` says neither yes nor no.
        """
        clock = _clocks.get(node)
        if clock is None:
            sim = wants_sim_time(os.environ.get(USE_SIM_TIME), USE_SIM_TIME)
            clock = _clocks[node] = cls(node, sim=sim)
        if clock._is_sim:
            clock._follow_clock(node)
        return clock

    # -- what time it is -----------------------------------------------------------------------

    @property
    def is_sim(self) -> bool:
        """Whether it goes by ``/clock``."""
        return self._is_sim

    def now(self) -> Time:
        """The time; with simulated time 0 until the first ``/clock``."""
        return Time(self._sim.nanoseconds if self._is_sim else time.time_ns())

    def monotonic(self) -> float:
        """Seconds since some moment, for measuring; comparable while `epoch` stays the same."""
        if self._is_sim:
            return self._sim.seconds
        try:
            # The same in a program; in a test the loop may have a time of its own.
            return asyncio.get_running_loop().time()
        except RuntimeError:
            return time.monotonic()

    def has_come(self, due_s: float) -> bool:
        """Whether it is ``due_s`` of `monotonic`, or later."""
        return self.monotonic() >= due_s - (_SLACK_S if self._is_sim else 0.0)

    # -- simulated time ------------------------------------------------------------------------

    def use_sim_time(self, on: bool) -> None:
        """Go by ``/clock``, or by the computer's clock; timers start over with a full period.

        Raises:
            HandleClosed: The node has ended.
        """
        node = self._node()
        if self._ended or node is None or node.is_closed:
            raise HandleClosed(f"node {self._name!r}")
        if on is self._is_sim:
            return
        self._is_sim = on
        self._sim = SimTime()
        if on:
            self._follow_clock(node)
        else:
            self._unfollow()
        self._tell(ClockChange.SWITCHED)

    async def wait_for_clock(self, timeout: float | None = None) -> None:
        """Return when there is a time: at once, or with the first ``/clock``.

        Raises:
            TimeoutError: Not within ``timeout`` seconds.
            HandleClosed: The node ended meanwhile.
        """
        async with asyncio.timeout(timeout):
            while self._is_sim and not self._sim.has_come:
                await self._next_change(None)

    def _follow_clock(self, node: NodeHandle) -> None:
        if not node.port or node.is_closed:
            return
        loop = asyncio.get_running_loop()
        if self._follower is None:
            self._follower = loop.create_task(self._follow(node), name=f"clock of {self._name}")
        if self._warning is None and not self._sim.has_come:
            self._warning = loop.call_later(_WARN_AFTER_S, self._warn)

    async def _follow(self, node: NodeHandle) -> None:
        """Take what comes on the topic until the node ends, or until cancelled by `_unfollow`."""
        try:
            subscriber = await node.subscribe(
                CLOCK_TOPIC, ClockMsg, self._clock_came, qos=CLOCK_QOS
            )
        except HandleClosed:
            self._end()
            return
        except SimpleRosError as error:
            self._cannot_follow(error)
            return
        try:
            await node.wait_ended()
        except asyncio.CancelledError:
            if self._follower is asyncio.current_task():
                raise
            await subscriber.close()
            return
        self._end()

    def _cannot_follow(self, error: SimpleRosError) -> None:
        logger.error("node %r cannot follow simulated time: %s", self._name, error)

    def _unfollow(self) -> None:
        self._stop_warning()
        follower, self._follower = self._follower, None
        if follower is not None:
            self._leaving.add(follower)
            follower.add_done_callback(self._leaving.discard)
            follower.cancel()

    def _stop_warning(self) -> None:
        if self._warning is not None:
            self._warning.cancel()
            self._warning = None

    def _end(self) -> None:
        self._ended = True
        self._stop_warning()
        self._wake()

    def _warn(self) -> None:
        logger.warning(
            "node %r goes by simulated time, but nothing has come on topic %r for %g s: its timers "
            "stand still; start what publishes it, or unset %s or use_sim_time",
            self._name,
            CLOCK_TOPIC,
            _WARN_AFTER_S,
            USE_SIM_TIME,
        )

    def _clock_came(self, message: ClockMsg) -> None:
        if not self._is_sim:
            return
        try:
            stamp = Time.from_msg(message.clock)
        except (ValueError, OverflowError) as error:
            if not self._told_bad:
                self._told_bad = True
                logger.warning("node %r ignores a bad time on %r: %s", self._name, "clock", error)
            return
        change = self._sim.receive(stamp.nanoseconds)
        if change is ClockChange.STARTED:
            self._stop_warning()
        self._tell(change)

    # -- who waits -----------------------------------------------------------------------------

    def add_listener(self, listener: ClockListener) -> None:
        """Call with each change of simulated time, and when it is switched on or off."""
        self._listeners[listener] = None

    def remove_listener(self, listener: ClockListener) -> None:
        """Call no more."""
        self._listeners.pop(listener, None)

    def _tell(self, change: ClockChange) -> None:
        if change.breaks:
            self.epoch += 1
        for listener in list(self._listeners):
            listener(change)
        self._wake()

    def _wake(self) -> None:
        moved, self._moved = self._moved, None
        if moved is not None and not moved.done():
            moved.set_result(None)

    def _change(self) -> asyncio.Future[None]:
        if self._moved is None:
            self._moved = asyncio.get_running_loop().create_future()
        return self._moved

    async def _next_change(self, timeout_s: float | None) -> None:
        await asyncio.wait((self._change(),), timeout=timeout_s)
        if self._ended:
            raise HandleClosed(f"node {self._name!r}")

    async def sleep_until(self, moment: Time) -> bool:
        """Sleep until a moment of this clock has come.

        Returns:
            False if the clock went back or was switched before.

        Raises:
            ClockTypeMismatch: The moment is of another kind of clock.
            HandleClosed: The node ended meanwhile, with simulated time.
        """
        if moment.clock_type is not ClockType.ROS_TIME:
            raise ClockTypeMismatch("wait by", ClockType.ROS_TIME, moment.clock_type)
        epoch = self.epoch
        while self.epoch == epoch and (left := moment.nanoseconds - self.now().nanoseconds) > 0:
            await self._next_change(None if self._is_sim else left / 1e9)
        return self.epoch == epoch

    async def sleep_for(self, span: Duration | float) -> bool:
        """Sleep for a duration, or seconds, of this clock; as `sleep_until`."""
        seconds = span.seconds if isinstance(span, Duration) else span
        await self.wait_for_clock()
        return await self.reach(self.monotonic() + seconds)

    async def reach(self, due_s: float) -> bool:
        """Sleep until ``due_s`` of `monotonic`; as `sleep_until`."""
        epoch = self.epoch
        while self.epoch == epoch and not self.has_come(due_s):
            await self._next_change(None if self._is_sim else due_s - self.monotonic())
        return self.epoch == epoch

    def rate(self, hz: float) -> Rate:
        """A rate by this clock, from now.

        Raises:
            ConfigError: The rate is not a positive number.
        """
        return Rate(hz, self)


class Rate:
    """Lets a loop run so many times a second of a clock. Made by `Clock.rate`."""

    def __init__(self, hz: float, clock: Clock) -> None:
        self._clock = clock
        self._schedule = RateSchedule(hz, clock.monotonic())
        self._epoch = clock.epoch

    async def sleep(self) -> bool:
        """Wait for the end of the present turn.

        A turn that is late by more than a period begins a new phase.

        Returns:
            False if the turn was late already, or the clock went back or was switched.

        Raises:
            HandleClosed: The node ended meanwhile, with simulated time.
        """
        clock = self._clock
        await clock.wait_for_clock()
        if clock.epoch != self._epoch:
            self._epoch = clock.epoch
            self._schedule.restart(clock.monotonic())
            return False
        end = self._schedule.turn_end(clock.monotonic())
        if clock.has_come(end):
            await asyncio.sleep(0)
            return False
        return await clock.reach(end)
