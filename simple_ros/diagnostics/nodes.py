"""Diagnostics on the wire: who says how it is, and who gathers it."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Generic, Self, TypeVar

from simple_ros.clock import Clock
from simple_ros.diagnostics.aggregator import Aggregator
from simple_ros.diagnostics.status import Level, Status
from simple_ros.diagnostics.tasks import Task, Tasks
from simple_ros.diagnostics.topic_statistics import TopicStatistics, write
from simple_ros.msg.diagnostic_msgs import DiagnosticArray
from simple_ros.msg.std_msgs import Header
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher
from simple_ros.qos import QosProfile
from simple_ros.subscriber import Subscriber
from simple_ros.timers import Timer

__all__ = ["DIAGNOSTICS_TOPIC", "DiagnosticAggregator", "DiagnosticUpdater", "TopicWatch"]

DIAGNOSTICS_TOPIC = "/diagnostics"
AGGREGATED_TOPIC = "/diagnostics_agg"
QOS = QosProfile(depth=100)

MessageT = TypeVar("MessageT")


class UpdaterBase:
    """What updaters of both faces do.

    Attributes:
        tasks: What it looks at.
    """

    tasks: Tasks
    _clock: Clock
    _send: Callable[[DiagnosticArray], None]

    def add(self, name: str, *tasks: Task) -> None:
        """Look at something each time: a function that is given a `Status`, or a monitor.

        Raises:
            ConfigError: There is a task of that name.
        """
        self.tasks.add(name, *tasks)

    def remove(self, name: str) -> None:
        """Look at it no more.

        Raises:
            LookupError: There is no task of that name.
        """
        self.tasks.remove(name)

    def update(self) -> None:
        """Look and send now."""
        self._send(self.tasks.look(self._clock.now()))

    def broadcast(self, level: Level, message: str) -> None:
        """Send the same for every task, such as at start or end."""
        self._send(self.tasks.say(self._clock.now(), level, message))

    def now(self) -> float:
        """The time that monitors are told, in seconds."""
        return self._clock.now().seconds


class DiagnosticUpdater(UpdaterBase):
    """Looks at its tasks once a second and sends what it finds on ``diagnostics``.

    Made by `DiagnosticUpdater.create`. It goes by the node's clock.

    Attributes:
        tasks: What it looks at.
    """

    def __init__(
        self, node: NodeHandle, publisher: Publisher[DiagnosticArray], tasks: Tasks
    ) -> None:
        self.tasks = tasks
        self._clock = Clock.attach(node)
        self._publisher = publisher
        self._send = publisher.publish
        self._timer: Timer | None = None

    @classmethod
    async def create(
        cls, node: NodeHandle, *, hardware_id: str = "", period_s: float = 1.0
    ) -> Self:
        """An updater of a node; returns when the Master knows its publisher.

        Args:
            node: A started node.
            hardware_id: The device it is about, if any.
            period_s: Seconds between looks.

        Raises:
            ConfigError: The period is not a positive number.
        """
        publisher = await node.advertise(DIAGNOSTICS_TOPIC, DiagnosticArray, qos=QOS)
        updater = cls(node, publisher, Tasks(node.name, hardware_id))
        updater._timer = node.create_timer(period_s, lambda _: updater.update())
        return updater

    async def close(self) -> None:
        """Look and send no more."""
        if self._timer is not None:
            self._timer.close()
        await self._publisher.close()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()


class TopicWatch(Generic[MessageT]):
    """Counts what flows through a publisher or a subscription; a task of an updater.

    A subscription counts what its callback is given, a publisher what is given to `publish` here::

        watch = TopicWatch(node)
        subscriber = await node.subscribe("scan", LaserScan, watch.wrap(on_scan))
        updater.add("topic scan", watch.of(subscriber))

    Args:
        node: Its clock counts.
        needs_messages: Whether silence is an error.
    """

    def __init__(self, node: NodeHandle, *, needs_messages: bool = True) -> None:
        self._clock = Clock.attach(node)
        self._needs_messages = needs_messages
        self._statistics = TopicStatistics(self._now())
        self._publisher: Publisher[MessageT] | None = None
        self._subscriber: Subscriber[MessageT] | None = None

    def _now(self) -> float:
        return self._clock.now().seconds

    def of(self, handle: Publisher[MessageT] | Subscriber[MessageT]) -> Self:
        """Whose queue counters are told too; the watch itself."""
        if isinstance(handle, Publisher):
            self._publisher = handle
        else:
            self._subscriber = handle
        return self

    def wrap(self, callback: Callable[[MessageT], None]) -> Callable[[MessageT], None]:
        """A plain callback that counts, then calls another."""

        def counted(message: MessageT) -> None:
            self.count(message)
            callback(message)

        return counted

    def publish(self, message: MessageT) -> None:
        """Publish by the publisher given to `of`, and count.

        Raises:
            RuntimeError: No publisher was given.
        """
        if self._publisher is None:
            raise RuntimeError("TopicWatch.publish needs a publisher: call of(publisher) first")
        self._publisher.publish(message)
        self.count(message)

    def count(self, message: MessageT) -> None:
        """A message flowed."""
        sources = self._subscriber.publisher_count if self._subscriber is not None else 1
        stamp_s, seq = _stamp_and_seq(message)
        self._statistics.message(
            _size_of(message), self._now(), stamp_s=stamp_s, seq=seq, several=sources > 1
        )

    def run(self, status: Status, now_s: float) -> None:
        """Write down what flowed since the last look."""
        dropped = waiting = 0
        if self._publisher is not None:
            sent = self._publisher.statistics
            dropped, waiting = sent.dropped + sent.expired, sent.waiting
            status.add("subscribers", self._publisher.subscriber_count)
        if self._subscriber is not None:
            taken = self._subscriber.statistics
            dropped, waiting = taken.dropped + taken.expired, taken.waiting
            status.add("publishers", self._subscriber.publisher_count)
        facts = self._statistics.look(now_s, dropped=dropped, waiting=waiting)
        write(facts, status, needs_messages=self._needs_messages)


def _stamp_and_seq(message: Any) -> tuple[float, int | None]:
    header = getattr(message, "header", None)
    if not isinstance(header, Header):
        return 0.0, None
    return header.stamp.ToNanoseconds() / 1e9, header.seq


def _size_of(message: Any) -> int:
    if isinstance(message, bytes | bytearray | memoryview):
        return len(message)
    size = getattr(message, "ByteSize", None)
    return int(size()) if callable(size) else 0


class DiagnosticAggregator:
    """Gathers ``diagnostics`` into groups and sends them on ``diagnostics_agg`` once a second.

    Made by `DiagnosticAggregator.create`. What is stale is judged by the computer's clock.
    """

    def __init__(
        self, node: NodeHandle, publisher: Publisher[DiagnosticArray], gathered: Aggregator
    ) -> None:
        self._clock = Clock.attach(node)
        self._publisher = publisher
        self._gathered = gathered
        self._timer: Timer | None = None
        self._subscriber: Subscriber[DiagnosticArray] | None = None

    @classmethod
    async def create(
        cls,
        node: NodeHandle,
        groups: Mapping[str, Sequence[str]],
        *,
        base: str = "Robot",
        stale_after_s: float = 5.0,
        period_s: float = 1.0,
    ) -> Self:
        """An aggregator on a node.

        Args:
            node: A started node.
            groups: Names of groups and the prefixes of what they take.
            base: Name before all paths.
            stale_after_s: Seconds after which a status is stale.
            period_s: Seconds between reports.

        Raises:
            ConfigError: The groups or the times make no sense.
        """
        gathered = Aggregator(groups, base=base, stale_after_s=stale_after_s)
        publisher = await node.advertise(AGGREGATED_TOPIC, DiagnosticArray, qos=QOS)
        made = cls(node, publisher, gathered)
        made._subscriber = await node.subscribe(
            DIAGNOSTICS_TOPIC,
            DiagnosticArray,
            lambda array: gathered.receive(array, time.monotonic()),
            qos=QOS,
        )
        made._timer = node.create_timer(period_s, lambda _: made.report())
        return made

    def report(self) -> None:
        """Send the report now."""
        self._publisher.publish(self._gathered.report(self._clock.now(), time.monotonic()))

    async def close(self) -> None:
        """Gather and send no more."""
        if self._timer is not None:
            self._timer.close()
        if self._subscriber is not None:
            await self._subscriber.close()
        await self._publisher.close()
