"""Runs the agent of one board on the event loop, whatever line the board is on."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable

from simple_ros.aio import NodeHandle
from simple_ros.diagnostics import WARN, Status
from simple_ros.msg.registry import MsgFactory
from simple_ros_firmware_bridge.config import BoardConfig
from simple_ros_firmware_bridge.endpoints import BoardEndpoints
from simple_ros_firmware_bridge.latency import Latency
from simple_ros_firmware_bridge.mapping import TopicMap, graph_type
from simple_ros_firmware_bridge.memory_file import Memory
from simple_ros_firmware_bridge.services import BoardServices
from simple_ros_firmware_bridge.words import words_for
from simple_ros_firmware_bridge.xrce.agent import Agent
from simple_ros_firmware_bridge.xrce.creation import ObjectId
from simple_ros_firmware_bridge.xrce.events import Sample, ServiceCalled, ServiceReplied

__all__ = ["AgentHost"]

logger = logging.getLogger(__name__)


def _knows_type(dds_name: str) -> bool:
    name = graph_type(dds_name)
    return bool(name) and MsgFactory.instance().find_class(name) is not None


class AgentHost:
    """An agent with its endpoints, its timer and its memory.

    Args:
        node: The node it belongs to.
        config: What is known of the board.
        name: For the log.
        memory: Where its session is kept.
        send: Sends what the agent has to send; called after everything that may have made some.
        is_open: Whether there is a line to send on.
        is_backed_up: Whether it takes no more at the moment.
    """

    def __init__(
        self,
        node: NodeHandle,
        config: BoardConfig,
        name: str,
        memory: Memory,
        send: Callable[[], None],
        is_open: Callable[[], bool],
        is_backed_up: Callable[[], bool] = lambda: False,
    ) -> None:
        self.name = name
        self.agent = Agent(_knows_type, time.time_ns, config.profiles, memory.load())
        self.endpoints = BoardEndpoints(
            node,
            TopicMap(config.remap, config.prefix),
            self._write,
            is_backed_up,
            restamps=config.restamp,
        )
        self.services = BoardServices(node, TopicMap(config.remap, config.prefix), self)
        self.latency = Latency()
        self._memory = memory
        self._send = send
        self._is_open = is_open
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._seen_messages: dict[ObjectId, int] = {}
        self._looked_at = self._loop.time()

    def worked(self, now: float) -> None:
        """The agent was given what came at ``now``: answer, then tell the graph."""
        # Answers first: a board stands still until it has them.
        self.flush()
        is_changed = False
        for event in self.agent.events():
            self.endpoints.take(event)
            if isinstance(event, Sample):
                self.latency.add(self._loop.time() - now)
                continue
            self.services.take(event)
            if isinstance(event, ServiceCalled | ServiceReplied):
                continue
            is_changed = True
            level, text = words_for(event)
            logger.log(level, "board %s: %s", self.name, text)
        if is_changed:
            self._memory.keep(self.agent.remembered())

    def probe(self) -> None:
        """Ask a silent board for a sign of life."""
        if self._is_open():
            self.agent.probe()
            self.flush()

    def flush(self) -> None:
        """Send what there is, and come back when more is due."""
        self._send()
        due = self.agent.next_timeout() if self._is_open() else None
        if self._timer is not None:
            if due is not None and self._timer.when() <= due:
                return  # it looks again when it fires
            self._timer.cancel()
        self._timer = None if due is None else self._loop.call_at(due, self._timeout)

    def _timeout(self) -> None:
        self._timer = None
        self.agent.handle_timeout(self._loop.time())
        self.flush()

    def _write(self, reader: ObjectId, data: bytes, topic: str) -> None:
        if self._is_open():
            self.agent.write(reader, data, topic, self._loop.time())
            self.flush()

    def reply(self, requester: ObjectId, call: bytes, data: bytes, name: str) -> None:
        """The reply to a call of the board. Raises as `Session.write`."""
        if self.agent.session is not None and self._is_open():
            self.agent.session.reply(requester, call, data, name, self._loop.time())
            self.flush()

    def request(self, replier: ObjectId, call: int, data: bytes, name: str) -> None:
        """A request for a service of the board. Raises as `Session.write`."""
        if self.agent.session is not None and self._is_open():
            self.agent.session.request(replier, call, data, name, self._loop.time())
            self.flush()

    def add_values(self, status: Status) -> None:
        """What the streams and topics of the board do."""
        counters = self.agent.counters
        status.add("malformed messages", counters.malformed)
        status.add("messages of unknown sessions", counters.strangers)
        self._add_streams(status)
        latency = self.latency.take()
        for name, seconds in (
            ("mean", latency.mean),
            ("p99", latency.p99),
            ("worst", latency.worst),
        ):
            status.add(f"latency to topic, {name} (ms)", f"{seconds * 1e3:.3f}")
        status.add("latency to topic, over 1 ms", f"{latency.late} of {latency.count}")
        if self.endpoints.offset.offset_ns is not None:
            status.add("added to stamps (s)", f"{self.endpoints.offset.offset_ns / 1e9:.6f}")
        now = self._loop.time()
        elapsed, self._looked_at = max(1e-9, now - self._looked_at), now
        for object_id, flow in self.endpoints.flows.items():
            before = self._seen_messages.get(object_id, 0)
            self._seen_messages[object_id] = flow.messages
            status.add(f"{flow.topic} (Hz)", f"{(flow.messages - before) / elapsed:.1f}")
            if flow.refused:
                status.merge_summary(WARN, flow.problem)

    def _add_streams(self, status: Status) -> None:
        if self.agent.session is None:
            return
        for source in self.agent.session.streams.inputs:
            for name, value in vars(source.counters).items():
                status.add(f"up: {name}", value)
        for downlink in self.agent.session.streams.downlinks:
            for name, value in vars(downlink.output.counters).items():
                status.add(f"down: {name}", value)
            status.add("down: replaced by newer", downlink.replaced)

    async def close(self) -> None:
        """Stop; the session is kept for the next start."""
        if self._timer is not None:
            self._timer.cancel()
        await self.endpoints.close()
        await self.services.close()
