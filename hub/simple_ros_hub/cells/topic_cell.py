"""Cells that live on topics: a node around a cell, with signs of life and a budget for what it sends."""

from __future__ import annotations

import asyncio
import os
import socket
import time
from abc import abstractmethod
from typing import Any, ClassVar

from simple_ros.msg.wireless_ros_msgs import (
    CellStatus,
    ChannelState,
    Constraint,
    Degradation,
    EngineStatus,
    ResourceGrants,
)
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher
from simple_ros.qos import LATCHED, Durability, QosProfile
from simple_ros_hub.cells.cell import Cell
from simple_ros_hub.cells.messages import cell_status
from simple_ros_hub.components import NAMESPACE
from simple_ros_hub.flow import PriorityGate, TokenBucket
from simple_ros_hub.outlets import Outlet

__all__ = ["Budget", "TopicCell"]

_HEARTBEAT_S = 0.5
_STATUS_S = 1.0
_MONITOR_S = 5.0
_PUMP_S = 0.005


class Budget:
    """What a cell may send, from constraint, grant and degradation.

    Attributes:
        share: Of the link, 0..1.
        rate_factor: Of the degradation.
        min_priority: Of the degradation.
    """

    def __init__(self, share: float) -> None:
        self.share = share
        self.rate_factor = 1.0
        self.min_priority = 1
        self._rates: dict[str, float] = {}

    def limit(self, who: str, rate_bps: float) -> None:
        """A limit of the whole link; 0 for none."""
        if rate_bps > 0:
            self._rates[who] = rate_bps
        else:
            self._rates.pop(who, None)

    @property
    def bytes_per_s(self) -> float:
        """Of this cell; 0 for no limit."""
        least = min(self._rates.values(), default=0.0)
        return least * self.share / 8

    def allows(self, priority: int) -> bool:
        """Whether a cell of that priority may send at all."""
        return priority >= self.min_priority


class TopicCell(Cell):
    """A cell with a node of its own, run by ``simple-ros cell run``.

    Parameters of its node: ``link`` (whose constraint counts; empty takes any), ``share`` (of the link, 0..1),
    ``priority`` (1..5), ``deadline`` (s, after which a message is of no use).

    Attributes:
        cell_name: Name of its node and of the cell, unless another is given.
        summary: What it does, in one line.
        priority: 1 lowest to 5.
        share: Of the link, unless the parameter says otherwise.
        deadline_s: The same of its deadline.
    """

    cell_name: ClassVar[str]
    summary: ClassVar[str]
    priority: int = 3
    share: ClassVar[float] = 0.3
    deadline_s: float = 0.5

    def __init__(self) -> None:
        super().__init__(self.cell_name)
        self.budget = Budget(self.share)
        self.messages_in = self.messages_out = self.bytes_in = self.bytes_out = 0
        self.held_back = 0
        self._gate: PriorityGate[tuple[Publisher[Any], bytes]] = PriorityGate(
            TokenBucket(0, 0, time.monotonic()), limit=20
        )
        self._link = ""
        self._something = asyncio.Event()

    @property
    def node_name(self) -> str:
        """Name of its node."""
        return f"{NAMESPACE}/{self.cell_name}"

    async def run(self, node: NodeHandle) -> None:
        """Work until cancelled or the node ends."""
        await self._declare(node)
        await self.set_up(node)
        await self._listen(node)
        self.start()
        await self._tell(node)
        sending = asyncio.create_task(self._pump())
        try:
            await node.spin()
        finally:
            sending.cancel()
            await asyncio.gather(sending, return_exceptions=True)
            self.stop()

    @abstractmethod
    async def set_up(self, node: NodeHandle) -> None:
        """Declare, advertise and subscribe."""

    async def _declare(self, node: NodeHandle) -> None:
        get = node.declare_parameter
        self._link = str(await get("~link", "", read_only=True))
        self.budget.share = float(await get("~share", self.share, minimum=0.001, maximum=1))
        self.priority = int(await get("~priority", self.priority, minimum=1, maximum=5))
        self.deadline_s = float(await get("~deadline", self.deadline_s, minimum=0.01, maximum=60))
        node.on_parameter_changed("~share", self._share_changed)
        node.on_parameter_changed("~priority", self._priority_changed)

    def _share_changed(self, value: Any) -> None:
        self.budget.share = float(value)
        self._rate_changed()
        self.numbers.parameter_set(time.monotonic())

    def _priority_changed(self, value: Any) -> None:
        self.priority = int(value)
        self.numbers.parameter_set(time.monotonic())

    async def _listen(self, node: NodeHandle) -> None:
        await node.subscribe(f"/{NAMESPACE}/constraints", Constraint, self._constraint_came)
        await node.subscribe(f"/{NAMESPACE}/channel_state", ChannelState, self._channel_came)
        await node.subscribe(
            f"/{NAMESPACE}/resource_grants", ResourceGrants, self._grants_came, qos=LATCHED
        )
        await node.subscribe(
            f"/{NAMESPACE}/degradation", Degradation, self._degradation_came, qos=LATCHED
        )

    def _is_mine(self, link_id: str) -> bool:
        return self._link in ("", link_id)

    def _constraint_came(self, message: Constraint) -> None:
        if self._is_mine(message.link_id):
            self.budget.limit("constraint", message.max_data_rate * 1e6)
            self.apply_constraints(message)
            self._rate_changed()

    def _channel_came(self, message: ChannelState) -> None:
        if self._is_mine(message.link_id):
            self.on_channel_update(message)

    def _grants_came(self, message: ResourceGrants) -> None:
        for grant in message.grants:
            if self._is_mine(grant.link_id):
                # The very least stands for nothing: a limit of 0 would be none.
                self.budget.limit("grant", max(8.0, grant.granted_bps))
                self._rate_changed()
                return
        self.budget.limit("grant", 0.0)
        self._rate_changed()

    def _degradation_came(self, message: Degradation) -> None:
        self.budget.rate_factor = message.rate_factor
        self.budget.min_priority = message.min_priority
        self.on_degradation(message)

    def on_degradation(self, message: Degradation) -> None:
        """The hub gives something up, or takes it back."""

    def _rate_changed(self) -> None:
        rate = self.budget.bytes_per_s
        self._gate.bucket.set_rate(rate, max(1500.0, rate / 4), time.monotonic())

    # -- sending -------------------------------------------------------------------------------

    def send(self, publisher: Publisher[Any], data: bytes) -> bool:
        """Send as soon as the budget allows; whether it may be sent at all now."""
        if not self.budget.allows(self.priority):
            self.held_back += 1
            return False
        until_s = time.monotonic() + self.deadline_s
        self._gate.put((publisher, data), len(data), self.priority, until_s)
        self._flush()
        if len(self._gate):
            self._something.set()
        return True

    def _flush(self) -> None:
        before = self._gate.expired + self._gate.overflowed
        for publisher, data in self._gate.take(time.monotonic()):
            publisher.publish_bytes(data)
            self.messages_out += 1
            self.bytes_out += len(data)
        self.held_back += self._gate.expired + self._gate.overflowed - before

    async def _pump(self) -> None:
        while True:
            wait_s = self._gate.wait_s(time.monotonic())
            if wait_s is None:
                self._something.clear()
                await self._something.wait()
                continue
            await asyncio.sleep(min(0.1, max(_PUMP_S, wait_s)))
            self._flush()

    def came(self, size_bytes: int) -> None:
        """A message to work on came."""
        self.messages_in += 1
        self.bytes_in += size_bytes

    # -- telling -------------------------------------------------------------------------------

    async def _tell(self, node: NodeHandle) -> None:
        space = f"/{NAMESPACE}"
        # Latched: the hub learns at once that the cell works, whenever it comes to listen.
        lasting = QosProfile(depth=1, durability=Durability.TRANSIENT_LOCAL)
        heartbeat = Outlet(await node.advertise(f"{space}/status", EngineStatus, qos=lasting), node)
        status = Outlet(await node.advertise(f"{space}/cell_status", CellStatus, qos=lasting), node)
        heartbeat.publish(self._heartbeat(node))
        node.create_timer(_HEARTBEAT_S, lambda _: heartbeat.publish(self._heartbeat(node)))
        node.create_timer(_STATUS_S, lambda _: status.publish(self._status()))
        node.create_timer(_MONITOR_S, lambda _: self.monitor())

    def _heartbeat(self, node: NodeHandle) -> EngineStatus:
        return EngineStatus(
            name=node.name,
            kind="cell",
            mode="realtime",
            state="active" if self.active else "degraded",
            detail="" if self.active else self.detail,
            processed=self.numbers.executions,
            skipped=self.numbers.skipped + self.held_back,
            errors=self.numbers.errors,
            pid=os.getpid(),
            host=socket.gethostname(),
            cpu_percent=self.resources.cpu_percent,
            memory_bytes=self.resources.memory_bytes,
        )

    def _status(self) -> CellStatus:
        message = cell_status(self.get_status())
        message.messages_in, message.messages_out = self.messages_in, self.messages_out
        message.bytes_in, message.bytes_out = self.bytes_in, self.bytes_out
        message.held_back = self.held_back
        return message
