"""Services that a board provides, and services that a board calls."""

from __future__ import annotations

import asyncio
import itertools
import logging
from collections.abc import Callable, Coroutine
from typing import Any, Protocol

from google.protobuf.message import Message

from simple_ros.aio import NodeHandle, ServiceClient, ServiceServer
from simple_ros.errors import ServiceCallError, SimpleRosError
from simple_ros.msg.registry import MsgFactory
from simple_ros_firmware_bridge import cdr
from simple_ros_firmware_bridge.mapping import TopicMap, graph_type
from simple_ros_firmware_bridge.xrce.creation import ObjectId
from simple_ros_firmware_bridge.xrce.events import (
    Endpoint,
    EndpointGone,
    Event,
    ServiceCalled,
    ServiceOffered,
    ServiceReplied,
    ServiceWanted,
    SessionClosed,
)

__all__ = ["BoardServices", "ServiceLine"]

logger = logging.getLogger(__name__)

_BOARD_LIMIT_S = 5.0
_GRAPH_LIMIT_S = 10.0

Pair = tuple[type[Message], type[Message]]


class ServiceLine(Protocol):
    """The way to the board."""

    def reply(self, requester: ObjectId, call: bytes, data: bytes, name: str) -> None:
        """The reply to a call of the board."""

    def request(self, replier: ObjectId, call: int, data: bytes, name: str) -> None:
        """A request for a service of the board."""


class BoardServices:
    """Follows the events of one board.

    Args:
        node: Whose services and clients they are.
        names: What services are called.
        line: The way to the board.
    """

    def __init__(self, node: NodeHandle, names: TopicMap, line: ServiceLine) -> None:
        self._node = node
        self._names = names
        self._line = line
        self._numbers = itertools.count(1)
        self._waiting: dict[int, asyncio.Future[ServiceReplied]] = {}
        self._servers: dict[ObjectId, ServiceServer[Any, Any]] = {}
        self._clients: dict[ObjectId, tuple[ServiceClient[Any, Any], Pair]] = {}
        self._wanted: set[ObjectId] = set()
        self._tasks: set[asyncio.Task[None]] = set()

    def take(self, event: Event) -> None:
        """An event of the board."""
        match event:
            case ServiceOffered(endpoint):
                self._wanted.add(endpoint.object_id)
                self._start(self._offer(endpoint))
            case ServiceWanted(endpoint):
                self._want(endpoint)
            case ServiceCalled():
                self._start(self._call(event))
            case ServiceReplied():
                waiting = self._waiting.pop(event.call, None)
                if waiting is not None and not waiting.done():
                    waiting.set_result(event)
            case EndpointGone(object_id):
                self._forget(object_id)
            case SessionClosed():
                for object_id in [*self._wanted, *self._clients]:
                    self._forget(object_id)

    def _start(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _pair(self, endpoint: Endpoint) -> Pair:
        factory = MsgFactory.instance()
        request, reply = graph_type(endpoint.type_name), graph_type(endpoint.reply_type)
        return factory.get_class(request), factory.get_class(reply)

    async def _offer(self, endpoint: Endpoint) -> None:
        if endpoint.object_id in self._servers:
            return
        try:
            name = self._names.topic(endpoint.topic)
            handler = self._asking(endpoint, name, self._pair(endpoint)[1])
            server = await self._node.advertise_service(name, self._pair(endpoint), handler)
        except SimpleRosError as error:
            logger.warning("service %r of the board is not offered: %s", endpoint.topic, error)
            return
        if endpoint.object_id in self._wanted:
            self._servers[endpoint.object_id] = server
        else:
            await server.close()

    def _asking(
        self, endpoint: Endpoint, name: str, reply_class: type[Message]
    ) -> Callable[[Message], Coroutine[Any, Any, Message]]:
        async def ask(request: Message) -> Message:
            number = next(self._numbers) & 0xFFFFFFFF
            waiting = asyncio.get_running_loop().create_future()
            self._waiting[number] = waiting
            try:
                self._line.request(endpoint.object_id, number, cdr.encode(request), name)
                async with asyncio.timeout(_BOARD_LIMIT_S):
                    reply = await waiting
            except TimeoutError:
                raise ServiceCallError(
                    name, f"the board did not answer within {_BOARD_LIMIT_S:g} s"
                ) from None
            finally:
                self._waiting.pop(number, None)
            return cdr.decode(reply.data, reply_class, reply.order)

        return ask

    def _want(self, endpoint: Endpoint) -> None:
        try:
            pair = self._pair(endpoint)
            client = self._node.service_client(
                self._names.topic(endpoint.topic), pair, timeout=_GRAPH_LIMIT_S
            )
        except SimpleRosError as error:
            logger.warning("service %r for the board: %s", endpoint.topic, error)
            return
        self._clients[endpoint.object_id] = client, pair

    async def _call(self, event: ServiceCalled) -> None:
        """Without an answer the board waits in vain, as micro-ROS has no other way to say it."""
        found = self._clients.get(event.requester)
        if found is None:
            return
        client, (request_class, _) = found
        try:
            reply = await client.call(cdr.decode(event.data, request_class, event.order))
            self._line.reply(event.requester, event.call, cdr.encode(reply), client.name)
        except (SimpleRosError, LookupError) as error:
            logger.warning("the board called and gets no answer: %s", error)

    def _forget(self, object_id: ObjectId) -> None:
        self._wanted.discard(object_id)
        server = self._servers.pop(object_id, None)
        if server is not None:
            self._start(server.close())
        found = self._clients.pop(object_id, None)
        if found is not None:
            self._start(found[0].close())

    async def close(self) -> None:
        """Close everything."""
        for task in list(self._tasks):
            task.cancel()
        for server in self._servers.values():
            await server.close()
        for client, _ in self._clients.values():
            await client.close()
