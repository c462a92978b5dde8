"""What the three engines have in common: mode, status, parameters that change while they run."""

from __future__ import annotations

import asyncio
import logging
import time
from abc import abstractmethod
from collections.abc import Hashable
from typing import Any, Generic, TypeVar

from google.protobuf.message import Message

from simple_ros.engine import Engine
from simple_ros.msg.wireless_ros_msgs import EngineStatus
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher
from simple_ros.qos import QosProfile
from simple_ros_engines.modes import Intake, IntervalControl, Mode, mode_of

__all__ = ["NAMESPACE", "Outlet", "WirelessEngine", "outlet"]

logger = logging.getLogger(__name__)

NAMESPACE = "wireless_ros"
HEARTBEAT_S = 0.5
Item = TypeVar("Item")
MessageT = TypeVar("MessageT", bound=Message)


class Outlet(Generic[MessageT]):
    """A publisher that numbers its messages.

    Args:
        publisher: Of a message with a header.
    """

    def __init__(self, publisher: Publisher[MessageT]) -> None:
        self._publisher = publisher
        self._seq = 0

    @property
    def is_heard(self) -> bool:
        """Whether anybody listens."""
        return self._publisher.subscriber_count > 0

    def publish(self, message: MessageT) -> None:
        """Number and send."""
        header: Any = getattr(message, "header")  # noqa: B009
        header.seq = self._seq
        self._seq = (self._seq + 1) & 0xFFFFFFFF
        self._publisher.publish(message)


class WirelessEngine(Engine, Generic[Item]):
    """An engine that takes items of links and looks at them as its mode says.

    Parameters of its node, all below its name: ``mode`` (realtime, burst, optimized), ``burst_interval``
    (s), ``update_interval`` (s, ticks of optimized), ``budget`` (items a tick of optimized).
    """

    update_interval_s = 0.1

    def __init__(self) -> None:
        self.state = "starting"
        self.detail = ""
        self.processed = 0
        self.errors = 0
        self._spent_s = 0.0
        self._longest_s = 0.0
        self._intake: Intake[Item] = Intake(Mode.REALTIME)
        self._control = IntervalControl(self.update_interval_s)

    async def run(self, node: NodeHandle) -> None:
        """Work until cancelled or the node ends."""
        await self._declare_common(node)
        await self.set_up(node)
        status = await node.advertise(
            f"/{NAMESPACE}/status", EngineStatus, qos=QosProfile(depth=10)
        )
        heartbeat = Outlet(status)
        node.create_timer(HEARTBEAT_S, lambda _: heartbeat.publish(self.status(node)))
        self.state = "active" if self.state == "starting" else self.state
        ticking = asyncio.create_task(self._tick(node))
        try:
            await self.work(node)
        finally:
            ticking.cancel()
            await asyncio.gather(ticking, return_exceptions=True)

    @abstractmethod
    async def set_up(self, node: NodeHandle) -> None:
        """Declare, advertise and subscribe."""

    async def work(self, node: NodeHandle) -> None:
        """What goes on until the end."""
        await node.spin()

    @abstractmethod
    def look_at(self, item: Item) -> None:
        """Look at an item, now."""

    @abstractmethod
    def link_count(self) -> int:
        """How many links are known."""

    def priority(self, item: Item) -> float:  # noqa: ARG002
        """Which items go first in mode optimized."""
        return 0.0

    def differs(self, before: Item, now: Item) -> bool:
        """Whether an item tells anything new in mode optimized."""
        return before != now

    def offer(self, key: Hashable, item: Item) -> None:
        """An item of a link came."""
        for due in self._intake.offer(key, item):
            self._look(due)

    def _look(self, item: Item) -> None:
        begun = time.perf_counter()
        try:
            self.look_at(item)
        except Exception:
            # One link's trouble must not be every link's.
            self.errors += 1
            logger.exception("%s cannot handle an item", self.node_name)
        took = time.perf_counter() - begun
        self.processed += 1
        self._spent_s += took
        self._longest_s = max(self._longest_s, took)

    async def _tick(self, node: NodeHandle) -> None:
        while True:
            if self._intake.mode is Mode.BURST:
                await asyncio.sleep(float(node.parameters["~burst_interval"]))
            else:
                await asyncio.sleep(self._control.interval_s)
            begun = time.perf_counter()
            for item in self._intake.tick():
                self._look(item)
            self._control.worked(time.perf_counter() - begun)

    async def _declare_common(self, node: NodeHandle) -> None:
        modes = tuple(mode.value for mode in Mode)
        await node.declare_parameter("~mode", Mode.REALTIME.value, choices=modes)
        await node.declare_parameter("~burst_interval", 1.0, minimum=0.01, maximum=60.0)
        await node.declare_parameter(
            "~update_interval", self.update_interval_s, minimum=0.01, maximum=10.0
        )
        await node.declare_parameter("~budget", 20, minimum=1, maximum=10_000)
        for name in ("~mode", "~update_interval", "~budget"):
            node.on_parameter_changed(name, lambda _: self._apply(node))
        self._apply(node)

    def _apply(self, node: NodeHandle) -> None:
        parameters = node.parameters
        mode = mode_of(str(parameters["~mode"]))
        waiting = self._intake.tick() if mode is not self._intake.mode else []
        skipped = self._intake.skipped
        self._intake = Intake(
            mode, priority=self.priority, differs=self.differs, budget=int(parameters["~budget"])
        )
        self._intake.skipped = skipped
        self._control = IntervalControl(float(parameters["~update_interval"]))
        for item in waiting:
            self._look(item)

    def status(self, node: NodeHandle) -> EngineStatus:
        """How it is, and what it did since the last time it was asked."""
        mean = self._spent_s / self.processed if self.processed else 0.0
        message = EngineStatus(
            name=node.name,
            mode=self._intake.mode.value,
            state=self.state,
            detail=self.detail,
            processed=self.processed,
            skipped=self._intake.skipped,
            errors=self.errors,
            links=self.link_count(),
            processing_ms_mean=1000 * mean,
            processing_ms_max=1000 * self._longest_s,
        )
        message.header.stamp.FromNanoseconds(node.clock.now().nanoseconds)
        self._longest_s = 0.0
        return message


async def outlet(
    node: NodeHandle, topic: str, message_class: type[MessageT], depth: int = 10
) -> Outlet[MessageT]:
    """A numbered publisher below the engines' namespace."""
    publisher = await node.advertise(
        f"/{NAMESPACE}/{topic}", message_class, qos=QosProfile(depth=depth)
    )
    return Outlet(publisher)
