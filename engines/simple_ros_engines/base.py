"""What the three engines have in common: mode, status, parameters that change while they run."""

from __future__ import annotations

import asyncio
import logging
import socket
import time
from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Hashable
from typing import Any, Generic, TypeVar

import psutil
from google.protobuf.message import Message

from simple_ros.engine import Engine
from simple_ros.msg.wireless_ros_msgs import EngineStatus
from simple_ros.msg.wireless_ros_msgs import Histogram as HistogramMessage
from simple_ros.node import NodeHandle
from simple_ros.qos import Durability, QosProfile
from simple_ros_engines.heartbeat import answer_heartbeats
from simple_ros_engines.histogram import BOUNDS_MS, Histogram
from simple_ros_engines.modes import Intake, IntervalControl, Mode, mode_of
from simple_ros_engines.topics import NAMESPACE, Inlet, Outlet, no_numbers, outlet

__all__ = ["NAMESPACE", "Inlet", "Outlet", "WirelessEngine", "outlet"]

logger = logging.getLogger(__name__)

HEARTBEAT_S = 0.5
_JUDGED = 100
_TOLD = 100
_ERROR_BUDGET = 0.05
Item = TypeVar("Item")
MessageT = TypeVar("MessageT", bound=Message)


class WirelessEngine(Engine, Generic[Item]):
    """An engine that takes items of links and looks at them as its mode says.

    Parameters of its node, all below its name: ``mode`` (realtime, burst, optimized), ``burst_interval``
    (s), ``update_interval`` (s, ticks of optimized), ``budget`` (items a tick of optimized).
    """

    update_interval_s = 0.1

    def __init__(self) -> None:
        self.state = "starting"
        self.detail = ""
        self.errors = 0
        self.inlets: list[Inlet[Any]] = []
        self.times = Histogram()
        self._longest_ms = 0.0
        self._failed: deque[bool] = deque(maxlen=_JUDGED)
        self._last_error = ""
        self._told: set[str] = set()
        self._process = psutil.Process()
        self._intake: Intake[Item] = Intake(Mode.REALTIME)
        self._control = IntervalControl(self.update_interval_s)
        self._changed = asyncio.Event()

    @property
    def processed(self) -> int:
        """How many items it looked at."""
        return self.times.count

    async def listen(
        self,
        node: NodeHandle,
        topic: str,
        message_class: type[MessageT],
        callback: Callable[[MessageT], None],
    ) -> None:
        """Subscribe to what another engine numbers; its gaps and duplicates are part of the status.

        Args:
            node: Subscribes.
            topic: Below the engines' namespace.
            message_class: Of a message with a header.
            callback: Called with each message that is new.
        """

        def take(message: MessageT) -> None:
            bad = no_numbers(message)
            if bad:
                # What is learnt from such a number would stay wrong for ever.
                self._failed.append(True)
                self._told_error(f"{topic} with {', '.join(bad)} that is no number")
            else:
                callback(message)

        inlet = Inlet(f"/{NAMESPACE}/{topic}", take)
        self.inlets.append(inlet)
        await node.subscribe(f"/{NAMESPACE}/{topic}", message_class, inlet.came)

    async def run(self, node: NodeHandle) -> None:
        """Work until cancelled or the node ends."""
        await self._declare_common(node)
        await self.set_up(node)
        await answer_heartbeats(node)
        # Latched and at once: the hub learns that the engine works whenever it comes to listen.
        lasting = QosProfile(depth=1, durability=Durability.TRANSIENT_LOCAL)
        heartbeat = Outlet(await node.advertise(f"/{NAMESPACE}/status", EngineStatus, qos=lasting))
        self.state = "active" if self.state == "starting" else self.state
        heartbeat.publish(self.status(node))
        node.create_timer(HEARTBEAT_S, lambda _: heartbeat.publish(self.status(node)))
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

    def forget(self, key: Hashable) -> None:
        """Nothing more is expected of a link."""
        self._intake.forget(key)

    def _look(self, item: Item) -> None:
        begun = time.perf_counter()
        failed = False
        try:
            self.look_at(item)
        except Exception as error:
            # One link's trouble must not be every link's.
            failed = True
            self._told_error(f"{type(error).__name__}: {error}", error)
        self._failed.append(failed)
        took_ms = 1000 * (time.perf_counter() - begun)
        self.times.add(took_ms)
        self._longest_ms = max(self._longest_ms, took_ms)

    def _told_error(self, text: str, error: Exception | None = None) -> None:
        self.errors += 1
        if text not in self._told and len(self._told) < _TOLD:
            self._told.add(text)
            logger.error("%s cannot handle an item: %s", self.node_name, text, exc_info=error)
        self._last_error = text

    async def _tick(self, node: NodeHandle) -> None:
        while True:
            if await self._changes_within(self._interval_s(node)):
                continue
            begun = time.perf_counter()
            for item in self._intake.tick():
                self._look(item)
            self._control.worked(time.perf_counter() - begun)

    def _interval_s(self, node: NodeHandle) -> float:
        if self._intake.mode is Mode.BURST:
            return float(node.parameters["~burst_interval"])
        return self._control.interval_s

    async def _changes_within(self, seconds: float) -> bool:
        """Whether a parameter changes meanwhile: an interval of a minute must not outlive its end."""
        self._changed.clear()
        try:
            async with asyncio.timeout(seconds):
                await self._changed.wait()
        except TimeoutError:
            return False
        return True

    async def _declare_common(self, node: NodeHandle) -> None:
        modes = tuple(mode.value for mode in Mode)
        await node.declare_parameter("~mode", Mode.REALTIME.value, choices=modes)
        await node.declare_parameter("~burst_interval", 1.0, minimum=0.01, maximum=60.0)
        await node.declare_parameter(
            "~update_interval", self.update_interval_s, minimum=0.01, maximum=10.0
        )
        await node.declare_parameter("~budget", 20, minimum=1, maximum=10_000)
        for name in ("~mode", "~burst_interval", "~update_interval", "~budget"):
            node.on_parameter_changed(name, lambda _: self._apply(node))
        self._apply(node)

    def _apply(self, node: NodeHandle) -> None:
        parameters = node.parameters
        mode = mode_of(str(parameters["~mode"]))
        waiting = self._intake.drain()
        skipped = self._intake.skipped
        self._intake = Intake(
            mode, priority=self.priority, differs=self.differs, budget=int(parameters["~budget"])
        )
        self._intake.skipped = skipped
        self._control = IntervalControl(float(parameters["~update_interval"]))
        self._changed.set()
        for item in waiting:
            self._look(item)

    def inactive_count(self) -> int:
        """How many links are known that say nothing now."""
        return 0

    def measures(self) -> dict[str, float]:
        """What else the engine counts and measures, by name."""
        return {}

    def verdict(self) -> tuple[str, str]:
        """State (active, degraded) and what is wrong."""
        overrun = self.error_overrun()
        return ("degraded", overrun) if overrun else (self.state, self.detail)

    def error_overrun(self) -> str:
        """That more of the last inputs failed than may, and why the last did; empty if not."""
        failed = sum(self._failed)
        if failed <= _ERROR_BUDGET * _JUDGED:
            return ""
        return f"{failed} of the last {len(self._failed)} inputs failed, with {self._last_error}"

    def status(self, node: NodeHandle) -> EngineStatus:
        """How it is, and what it did since the last time it was asked."""
        state, detail = self.verdict()
        times = self.times
        message = EngineStatus(
            name=node.name,
            mode=self._intake.mode.value,
            state=state,
            detail=detail,
            processed=times.count,
            skipped=self._intake.skipped,
            errors=self.errors,
            links=self.link_count(),
            inactive_links=self.inactive_count(),
            processing_ms_mean=times.mean_ms(),
            processing_ms_max=self._longest_ms,
            processing_ms_p50=times.quantile_ms(0.5),
            processing_ms_p99=times.quantile_ms(0.99),
            processing=HistogramMessage(bounds_ms=BOUNDS_MS, counts=times.counts),
            inputs=[inlet.flow() for inlet in self.inlets],
            measures=self.measures(),
            kind="engine",
            pid=self._process.pid,
            host=socket.gethostname(),
            cpu_percent=self._process.cpu_percent(),
            memory_bytes=self._process.memory_info().rss,
        )
        message.header.stamp.FromNanoseconds(node.clock.now().nanoseconds)
        self._longest_ms = 0.0
        return message
