"""The clock of a blocking node."""

from __future__ import annotations

from simple_ros.clock import Clock
from simple_ros.net.loop import BackgroundLoop
from simple_ros.node import NodeHandle
from simple_ros.time import Duration, Time

__all__ = ["BlockingClock", "BlockingRate"]


class BlockingClock:
    """What time it is for a node, from any thread; see `simple_ros.clock.Clock`."""

    def __init__(self, loop: BackgroundLoop, clock: Clock) -> None:
        self._loop = loop
        self.clock = clock

    @classmethod
    def attach(cls, loop: BackgroundLoop, node: NodeHandle) -> BlockingClock:
        """The clock of a node that lives on a background loop.

        Raises:
            ConfigError: ``SIMPLE_ROS_USE_SIM_TIME`` says neither yes nor no.
        """

        async def attached() -> Clock:
            return Clock.attach(node)

        return cls(loop, loop.run(attached()))

    @property
    def is_sim(self) -> bool:
        """Whether it goes by ``/clock``."""
        return self.clock.is_sim

    def now(self) -> Time:
        """The time; with simulated time 0 until the first ``/clock``."""
        return self.clock.now()

    def use_sim_time(self, on: bool) -> None:
        """Go by ``/clock``, or by the computer's clock; timers start over with a full period.

        Raises:
            HandleClosed: The node has ended.
        """

        async def switch() -> None:
            self.clock.use_sim_time(on)

        self._loop.run(switch())

    def wait_for_clock(self, timeout: float | None = None) -> None:
        """Return when there is a time: at once, or with the first ``/clock``.

        Raises:
            TimeoutError: Not within ``timeout`` seconds.
            HandleClosed: The node ended meanwhile.
        """
        self._loop.run(self.clock.wait_for_clock(timeout))

    def sleep_until(self, moment: Time) -> bool:
        """Sleep until a moment of this clock; see `simple_ros.clock.Clock.sleep_until`."""
        return self._loop.run(self.clock.sleep_until(moment))

    def sleep_for(self, span: Duration | float) -> bool:
        """Sleep for a duration, or seconds, of this clock; as `sleep_until`."""
        return self._loop.run(self.clock.sleep_for(span))

    def rate(self, hz: float) -> BlockingRate:
        """A rate by this clock, from now.

        Raises:
            ConfigError: The rate is not a positive number.
        """
        return BlockingRate(hz, self._loop, self.clock)


class BlockingRate:
    """Lets a loop run so many times a second of a clock. Made by `BlockingClock.rate`."""

    def __init__(self, hz: float, loop: BackgroundLoop, clock: Clock) -> None:
        self._loop = loop
        self._rate = clock.rate(hz)

    def sleep(self) -> bool:
        """Wait for the end of the present turn; see `simple_ros.clock.Rate.sleep`."""
        return self._loop.run(self._rate.sleep())
