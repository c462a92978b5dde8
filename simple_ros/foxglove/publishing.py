"""What clients publish: each of their channels is a publisher of the bridge's node."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from typing import Any

import grpc
from google.protobuf.message import DecodeError, Message

from simple_ros.errors import SimpleRosError, UnknownMessageType
from simple_ros.foxglove.access import Access
from simple_ros.foxglove.client import Client
from simple_ros.foxglove.errors import PublishRefused, one_line
from simple_ros.foxglove.graph_model import GraphModel, shown
from simple_ros.foxglove.json_input import message_of
from simple_ros.foxglove.requests import ClientChannel
from simple_ros.foxglove.type_book import TypeBook
from simple_ros.msg.registry import resolve_type_name
from simple_ros.names import topic_name
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher

__all__ = ["ClientPublishers", "spelt_out"]

logger = logging.getLogger(__name__)

_PENDING = 100
_MEET_S = 0.5


def spelt_out(schema_name: str) -> str:
    """The full name that a spelling means: ``pkg/Type``, ``pkg/msg/Type``, ``ros.pkg.Type``, ``pkg.Type``."""
    try:
        return resolve_type_name(schema_name)
    except UnknownMessageType:
        parts = schema_name.replace("::", "/").replace(".", "/").split("/")
        return ".".join(part for part in parts if part and part != "msg")


class _Outlet:
    """One channel of one client."""

    def __init__(self, channel: ClientChannel) -> None:
        self.channel = channel
        self.publisher: Publisher[Any] | None = None
        self.message_class: type[Message] | None = None
        self.pending: deque[bytes] = deque(maxlen=_PENDING)
        self.is_ready = False
        self.task: asyncio.Task[None] | None = None

    def publish(self, payload: bytes) -> None:
        """Publish a message.

        Raises:
            PublishRefused: It is no message of the topic's type.
        """
        assert self.publisher is not None
        assert self.message_class is not None
        if self.channel.encoding == "json":
            self.publisher.publish(message_of(self.message_class, payload))
            return
        try:
            self.message_class.FromString(payload)
        except DecodeError as error:
            name = self.message_class.DESCRIPTOR.full_name
            raise PublishRefused(f"not a {name}: {error}") from None
        self.publisher.publish_bytes(payload)


class ClientPublishers:
    """Publishes for clients.

    Args:
        node: Publishes.
        types: Knows types.
        graph: Knows which type a topic has.
        access: Which topics clients may publish.
    """

    def __init__(
        self, node: NodeHandle, types: TypeBook, graph: GraphModel, access: Access
    ) -> None:
        self._node = node
        self._types = types
        self._graph = graph
        self._access = access
        self._outlets: dict[tuple[Client, int], _Outlet] = {}
        self._tasks: set[asyncio.Task[None]] = set()

    def open(self, client: Client, channel: ClientChannel) -> None:
        """A client is going to publish."""
        outlet = _Outlet(channel)
        self._outlets[client, channel.id] = outlet
        outlet.task = self._start(self._prepare(client, outlet))

    def publish(self, client: Client, channel: ClientChannel, payload: bytes) -> None:
        """A client published a message."""
        outlet = self._outlets.get((client, channel.id))
        if outlet is None:
            return
        if not outlet.is_ready:
            outlet.pending.append(payload)
            return
        self._publish(client, outlet, payload)

    def close(self, client: Client, channel: ClientChannel) -> None:
        """A client publishes no more."""
        outlet = self._outlets.pop((client, channel.id), None)
        if outlet is not None:
            self._start(self._end(client, outlet))

    def _start(self, work: Any) -> asyncio.Task[None]:
        task: asyncio.Task[None] = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    async def _prepare(self, client: Client, outlet: _Outlet) -> None:
        channel = outlet.channel
        try:
            topic = topic_name(channel.topic)
            if not self._access.lets_publish(topic):
                raise PublishRefused("this server does not let clients publish it")
            known = await self._types.find(self._type_for(channel, topic))
            outlet.message_class = known.message_class
            outlet.publisher = await self._node.advertise(f"/{topic}", known.message_class)
            await self._meet(outlet.publisher)
        except (SimpleRosError, TypeError, grpc.aio.AioRpcError) as error:
            self._outlets.pop((client, channel.id), None)
            client.session.complain(f"Cannot publish on {channel.topic}: {one_line(error)}")
            client.process()
            return
        outlet.is_ready = True
        while outlet.pending:
            self._publish(client, outlet, outlet.pending.popleft())

    def _type_for(self, channel: ClientChannel, topic: str) -> str:
        """JSON fits any type, so the topic's own counts; bytes are of the type they were made for."""
        used = self._graph.type_of(topic)
        given = spelt_out(channel.schema_name) if channel.schema_name else ""
        if channel.encoding == "json" and used is not None:
            return used
        if not given:
            if used is None:
                raise PublishRefused("it has no type yet, and no schemaName was given")
            return used
        # Another program may publish under the very name that panels know, say `ros.pkg.Type`.
        if used is not None and used not in (given, channel.schema_name):
            raise PublishRefused(f"{shown(topic)} carries {used}, not {given}")
        return used or given

    async def _meet(self, publisher: Publisher[Any]) -> None:
        """Wait a little for the subscribers there are: a single message must reach them."""
        count = len(self._graph.subscribers_of(publisher.topic, publisher.msg_type))
        try:
            await publisher.wait_for_subscribers(count, timeout=_MEET_S)
        except TimeoutError:
            logger.debug("not all subscribers of %s came", publisher.topic)

    def _publish(self, client: Client, outlet: _Outlet, payload: bytes) -> None:
        try:
            outlet.publish(payload)
        except (SimpleRosError, TypeError, ValueError) as error:
            reason = one_line(error)
            client.session.complain(f"Message on {outlet.channel.topic} not published: {reason}")
            client.process()

    async def _end(self, client: Client, outlet: _Outlet) -> None:
        if outlet.task is not None:
            # What it published just before is still to leave.
            await asyncio.wait([outlet.task])
        self._outlets.pop((client, outlet.channel.id), None)
        if outlet.publisher is not None:
            await outlet.publisher.close()

    async def end(self) -> None:
        """Publish nothing more."""
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
