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
from simple_ros.msg.tf2_msgs import TFMessage
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
_LOOK_AGAIN_S = 0.005


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
        waiting: What goes to a best-effort reader when the line takes more; only the newest does.
    """

    endpoint: Endpoint
    topic: str
    message_class: type[Message]
    messages: int = 0
    refused: int = 0
    problem: str = ""
    handle: Publisher[Any] | Subscriber[Any] | None = None
    early: deque[Message] = field(default_factory=lambda: deque(maxlen=_EARLY))
    waiting: Message | None = None

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
        is_backed_up: Whether the line takes no more at the moment.
        restamps: Whether stamps that are no time of day are replaced.
    """

    def __init__(
        self,
        node: NodeHandle,
        names: TopicMap,
        write: Callable[[ObjectId, bytes, str], None],
        is_backed_up: Callable[[], bool] = lambda: False,
        *,
        restamps: bool = True,
    ) -> None:
        self.flows: dict[ObjectId, Flow] = {}
        self.offset = OffsetFilter()
        self._node = node
        self._names = names
        self._write = write
        self._is_backed_up = is_backed_up
        self._looking_again: asyncio.TimerHandle | None = None
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
        for part in message.transforms if isinstance(message, TFMessage) else (message,):
            if (header := getattr(part, "header", None)) is not None:
                self._restamp_header(header)

    def _restamp_header(self, header: Any) -> None:
        stamp = header.stamp
        stamp_ns = stamp.seconds * 10**9 + stamp.nanos
        if needs_new_stamp(stamp_ns):
            new = self.offset.restamped(stamp_ns, time.time_ns())
            stamp.seconds, stamp.nanos = divmod(new, 10**9)

    def _look_again(self) -> None:
        self._looking_again = None
        for flow in list(self.flows.values()):
            if flow.waiting is not None:
                self._down(flow, flow.waiting)

    def _down(self, flow: Flow, message: Message) -> None:
        # A reliable reader has its window; for a best-effort one what waits in the line would only grow old.
        if not flow.endpoint.reliable and self._is_backed_up():
            flow.waiting = message
            if self._looking_again is None:
                loop = asyncio.get_running_loop()
                self._looking_again = loop.call_later(_LOOK_AGAIN_S, self._look_again)
            return
        flow.waiting = None
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
        if self._looking_again is not None:
            self._looking_again.cancel()
        flows, self.flows = self.flows, {}
        for flow in flows.values():
            await self._close_flow(flow)
