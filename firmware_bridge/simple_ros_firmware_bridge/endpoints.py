"""A board's readers and writers as subscriptions and publishers of a node."""

from __future__ import annotations

import asyncio
import logging
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from google.protobuf.message import Message

from simple_ros.aio import NodeHandle, Publisher, Subscriber
from simple_ros.errors import MessageTooLarge, SimpleRosError
from simple_ros.msg.registry import MsgFactory
from simple_ros.qos import Durability, QosProfile, Reliability
from simple_ros_firmware_bridge import cdr
from simple_ros_firmware_bridge.mapping import TopicMap, graph_type
from simple_ros_firmware_bridge.stamps import OffsetFilter, needs_new_stamp
from simple_ros_firmware_bridge.xrce.creation import ObjectId
from simple_ros_firmware_bridge.xrce.events import (
    Endpoint,
    EndpointGone,
    Event,
    ReaderReady,
    Sample,
    SessionClosed,
    WriterReady,
)

__all__ = ["BoardEndpoints", "Flow"]

logger = logging.getLogger(__name__)

_EARLY = 100
_DOWN_DEPTH = 1


@dataclass
class Flow:
    """What flows through one reader or writer.

    Attributes:
        endpoint: On the board.
        topic: In the graph.
        message_class: Of its messages.
        messages: How many.
        refused: How many could not be carried.
        problem: Why the last of these could not.
    """

    endpoint: Endpoint
    topic: str
    message_class: type[Message]
    messages: int = 0
    refused: int = 0
    problem: str = ""
    handle: Publisher[Any] | Subscriber[Any] | None = None
    early: deque[Message] = field(default_factory=lambda: deque(maxlen=_EARLY))

    def refuse(self, problem: str) -> None:
        """A message could not be carried; the first of its kind is logged."""
        self.refused += 1
        if problem != self.problem:
            self.problem = problem
            logger.error("%s", problem)


class BoardEndpoints:
    """Follows the events of one board.

    Args:
        node: Whose publishers and subscriptions they are.
        names: What topics are called.
        write: Sends a sample to a reader of the board: id, CDR, topic.
        restamps: Whether stamps that are no time of day are replaced.
    """

    def __init__(
        self,
        node: NodeHandle,
        names: TopicMap,
        write: Callable[[ObjectId, bytes, str], None],
        *,
        restamps: bool = True,
    ) -> None:
        self.flows: dict[ObjectId, Flow] = {}
        self.offset = OffsetFilter()
        self._node = node
        self._names = names
        self._write = write
        self._restamps = restamps
        self._changes: asyncio.Queue[Callable[[], Any]] = asyncio.Queue()
        self._worker = asyncio.get_running_loop().create_task(self._work())

    def take(self, event: Event) -> None:
        """An event of the board."""
        match event:
            case Sample():
                self._sample(event)
            case WriterReady(endpoint):
                self._open(endpoint, self._advertise)
            case ReaderReady(endpoint):
                self._open(endpoint, self._subscribe)
            case EndpointGone(object_id):
                self._forget(object_id)
            case SessionClosed():
                for object_id in list(self.flows):
                    self._forget(object_id)

    def _open(self, endpoint: Endpoint, how: Callable[[Flow], Any]) -> None:
        known = self.flows.get(endpoint.object_id)
        if known is not None and known.endpoint == endpoint:
            return
        self._forget(endpoint.object_id)
        try:
            topic = self._names.topic(endpoint.topic)
            message_class = MsgFactory.instance().get_class(graph_type(endpoint.type_name))
        except SimpleRosError as error:
            logger.warning("topic %r of the board is not carried: %s", endpoint.topic, error)
            return
        cdr.prepare(message_class)
        flow = self.flows[endpoint.object_id] = Flow(endpoint, topic, message_class)
        self._changes.put_nowait(lambda: how(flow))

    def _forget(self, object_id: ObjectId) -> None:
        flow = self.flows.pop(object_id, None)
        if flow is not None:
            self._changes.put_nowait(lambda: self._close_flow(flow))

    async def _work(self) -> None:
        """One change after the other, in the order in which the board made them."""
        while True:
            change = await self._changes.get()
            try:
                await change()
            except SimpleRosError as error:
                logger.warning("a topic of the board is not carried: %s", error)

    async def _advertise(self, flow: Flow) -> None:
        durability = Durability.TRANSIENT_LOCAL if flow.endpoint.transient else Durability.VOLATILE
        publisher = await self._node.advertise(
            flow.topic, flow.message_class, qos=QosProfile(durability=durability)
        )
        flow.handle = publisher
        while flow.early:
            publisher.publish(flow.early.popleft())

    async def _subscribe(self, flow: Flow) -> None:
        reliability = Reliability.RELIABLE if flow.endpoint.reliable else Reliability.BEST_EFFORT
        flow.handle = await self._node.subscribe(
            flow.topic,
            flow.message_class,
            lambda message: self._down(flow, message),
            qos=QosProfile(depth=_DOWN_DEPTH, reliability=reliability),
        )

    async def _close_flow(self, flow: Flow) -> None:
        if flow.handle is not None:
            await flow.handle.close()

    def _sample(self, sample: Sample) -> None:
        flow = self.flows.get(sample.writer)
        if flow is None:
            return
        try:
            message = cdr.decode(sample.data, flow.message_class, sample.order)
        except cdr.CdrError as error:
            flow.refuse(f"topic {flow.topic!r}: the board sent what is no {error}")
            return
        flow.messages += 1
        if self._restamps:
            self._restamp(message)
        if isinstance(flow.handle, Publisher):
            flow.handle.publish(message)
        else:
            flow.early.append(message)

    def _restamp(self, message: Any) -> None:
        header = getattr(message, "header", None)
        if header is None:
            return
        stamp = header.stamp
        stamp_ns = stamp.seconds * 10**9 + stamp.nanos
        if needs_new_stamp(stamp_ns):
            new = self.offset.restamped(stamp_ns, time.time_ns())
            stamp.seconds, stamp.nanos = divmod(new, 10**9)

    def _down(self, flow: Flow, message: Message) -> None:
        try:
            self._write(flow.endpoint.object_id, cdr.encode(message), flow.topic)
            flow.messages += 1
        except MessageTooLarge as error:
            flow.refuse(
                f"topic {flow.topic!r}: a message of {error.size} bytes is too large for the board, "
                f"which takes {error.limit} at most; it was not sent"
            )
        except (cdr.CdrError, LookupError) as error:
            flow.refuse(f"topic {flow.topic!r}: {error}")

    async def close(self) -> None:
        """Close everything."""
        self._worker.cancel()
        flows, self.flows = self.flows, {}
        for flow in flows.values():
            await self._close_flow(flow)
