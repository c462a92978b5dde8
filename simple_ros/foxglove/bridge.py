"""The bridge: shows a graph of nodes to apps, and lets apps take part in it."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
from collections.abc import AsyncIterator, Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import grpc

from simple_ros.clock import Clock
from simple_ros.errors import MasterUnavailable
from simple_ros.foxglove.assets import AssetRoots
from simple_ros.foxglove.client import Client
from simple_ros.foxglove.errors import AssetRefused
from simple_ros.foxglove.events import (
    AssetWanted,
    Called,
    ChannelClosed,
    ChannelOpened,
    ChannelUnwanted,
    ChannelWanted,
    Event,
    GraphWanted,
    ParametersSet,
    ParametersWanted,
    Published,
)
from simple_ros.foxglove.frames import CAPABILITIES, Level
from simple_ros.foxglove.graph_model import ConnectionGraph, GraphModel, difference
from simple_ros.foxglove.parameter_desk import ParameterDesk
from simple_ros.foxglove.publishing import ClientPublishers
from simple_ros.foxglove.server import FoxgloveServer, ServerOptions
from simple_ros.foxglove.services import DEFAULT_TIMEOUT_S, Services, message_names
from simple_ros.foxglove.topics import Topics
from simple_ros.foxglove.type_book import TypeBook
from simple_ros.graph import GraphChange, GraphService, GraphSnapshot
from simple_ros.graph_source import fetch_graph
from simple_ros.net.master_client import ForeignMaster
from simple_ros.node import NodeHandle
from simple_ros.sim_time import ClockChange
from simple_ros.tasks import first_of

__all__ = ["Bridge", "BridgeOptions"]

logger = logging.getLogger(__name__)

_RETRY_S = 0.5
_POLL_S = 1.0
_LOOK_AGAIN_S = 1.0
_SETTLE_S = 1.0
_NO_MASTER = "no-master"


@dataclass(frozen=True)
class BridgeOptions:
    """How to bridge.

    Attributes:
        server: How to serve.
        assets: Files for clients.
        service_timeout_s: After how many seconds a call of a service has failed.
    """

    server: ServerOptions = field(default_factory=ServerOptions)
    assets: AssetRoots = field(default_factory=lambda: AssetRoots({}))
    service_timeout_s: float = DEFAULT_TIMEOUT_S


class Bridge:
    """Joins a node and a `FoxgloveServer`. Let `server` listen and await `run`.

    Args:
        node: A started node.
        options: How.

    Attributes:
        server: To listen with.
    """

    def __init__(self, node: NodeHandle, options: BridgeOptions) -> None:
        access = options.server.access
        hidden = access.hidden | {"playbackControl"}
        if not options.assets:
            hidden |= {"assets"}
        self._node = node
        self._clock = Clock.attach(node)
        self.server = FoxgloveServer(options.server, CAPABILITIES - hidden, self._now_ns)
        self.server.on_event = self._event
        self._access = access
        self._assets = options.assets
        self._graph = GraphModel()
        self._connections = ConnectionGraph()
        self._types = TypeBook(lambda: node.client)
        self._topics = Topics(node, self.server, self._types, self._now_ns)
        self._publishers = ClientPublishers(node, self._types, self._graph, access)
        timeout_s = options.service_timeout_s
        self._services = Services(node, self.server, self._types, timeout_s)
        self._parameters = ParameterDesk(node, self.server, access)
        self.server.on_gone = self._services.forget
        self._changed = asyncio.Event()
        self._settled_at = -math.inf
        self._fetching: dict[Client, asyncio.Task[None]] = {}
        self._handlers: dict[type, Callable[[Client, Any], None]] = {
            ChannelWanted: self._channel_wanted,
            ChannelUnwanted: lambda _client, _event: self._changed.set(),
            ChannelOpened: lambda client, event: self._publishers.open(client, event.channel),
            ChannelClosed: lambda client, event: self._publishers.close(client, event.channel),
            Published: lambda client, event: self._publishers.publish(
                client, event.channel, event.payload
            ),
            Called: self._services.call,
            AssetWanted: self._asset_wanted,
            ParametersWanted: self._parameters.take,
            ParametersSet: self._parameters.take,
            GraphWanted: self._graph_wanted,
        }

    async def run(self) -> None:
        """Bridge until cancelled.

        Raises:
            HandleClosed: The node was closed.
        """
        self._clock.add_listener(self._time_changed)
        try:
            await first_of(self._watch(), self._follow(), self._follow_parameters())
        finally:
            self._clock.remove_listener(self._time_changed)
            await self._publishers.end()
            await self._services.end()
            await self._parameters.end()

    async def _follow_parameters(self) -> None:
        await self._parameters.follow()
        await asyncio.Event().wait()

    # -- time ----------------------------------------------------------------------------------

    def _now_ns(self) -> int:
        return self._clock.now().nanoseconds

    def _time_changed(self, change: ClockChange) -> None:
        if change.breaks:
            self.server.reset_session()

    # -- the graph -----------------------------------------------------------------------------

    async def _watch(self) -> None:
        loop = asyncio.get_running_loop()
        was_lost = False
        async for item in _graph_of(self._node):
            if item is None:
                reason = f"No Master answers at {self._node.master}; what was known is shown"
                self.server.say_status(Level.WARNING, reason, _NO_MASTER)
                was_lost = True
                continue
            self.server.take_back_status(_NO_MASTER)
            if was_lost and self._graph.published():
                self._settled_at = loop.time() + _SETTLE_S
            was_lost = False
            self._graph.take(item)
            self._changed.set()

    async def _follow(self) -> None:
        """Make the server offer what the graph holds, and subscribe to what clients want."""
        while True:
            with contextlib.suppress(TimeoutError):
                missing = self._topics.unknown or self._services.unknown
                async with asyncio.timeout(_LOOK_AGAIN_S if missing else None):
                    await self._changed.wait()
            # A Master that was restarted does not know all nodes at once; what clients see stays.
            await asyncio.sleep(max(0.0, self._settled_at - asyncio.get_running_loop().time()))
            self._changed.clear()
            published = self._graph.published()
            wanted = {topic: kind for topic, kind in published.items() if self._access.wants(topic)}
            await self._topics.sync(wanted)
            await self._topics.follow_wishes(self._graph.publishers_of)
            if "services" not in self._access.hidden:
                await self._services.sync(self._shown_services())
            self._forget_types(wanted.values())
            self._tell_graph()

    def _shown_services(self) -> dict[str, GraphService]:
        wants = self._access.services.wants
        return {name: item for name, item in self._graph.services.items() if wants(name)}

    def _forget_types(self, used: Iterable[str]) -> None:
        services = self._graph.services.values()
        called = {name for service in services for name in message_names(service)}
        self._types.keep_only({*used, *called})

    def _tell_graph(self) -> None:
        connections = self._graph.connections(self._access.wants, self._access.services.wants)
        frame = difference(self._connections, connections)
        self._connections = connections
        if frame is not None:
            self.server.say_if(lambda session: session.wants_graph, frame)

    # -- what clients do -----------------------------------------------------------------------

    def _event(self, client: Client, event: Event) -> None:
        handler = self._handlers.get(type(event))
        if handler is not None:
            handler(client, event)

    def _channel_wanted(self, client: Client, event: ChannelWanted) -> None:
        self._topics.replay(client, event.channel_id)
        self._changed.set()

    def _graph_wanted(self, client: Client, event: GraphWanted) -> None:  # noqa: ARG002
        client.session.say(self._connections.frame())

    def _asset_wanted(self, client: Client, event: AssetWanted) -> None:
        before = self._fetching.get(client)
        task = asyncio.get_running_loop().create_task(self._fetch(client, event, before))
        self._fetching[client] = task
        task.add_done_callback(lambda done: self._fetched(client, done))

    def _fetched(self, client: Client, task: asyncio.Task[None]) -> None:
        if self._fetching.get(client) is task:
            del self._fetching[client]

    async def _fetch(
        self, client: Client, event: AssetWanted, before: asyncio.Task[None] | None
    ) -> None:
        """Send a file, when those before it have left: they may be large."""
        if before is not None:
            await asyncio.wait([before])
        await client.drained()
        try:
            loop = asyncio.get_running_loop()
            data = await loop.run_in_executor(None, self._assets.read, event.uri)
        except AssetRefused as error:
            client.session.refuse_asset(event.request_id, str(error))
            # Apps draw nothing where a mesh is missing, and do not say why.
            client.session.complain(str(error), Level.WARNING)
        else:
            client.session.send_asset(event.request_id, data)
        client.process()


async def _graph_of(node: NodeHandle) -> AsyncIterator[GraphSnapshot | GraphChange | None]:
    """The graph and its changes, from Masters of any kind; None when none answers, which is waited for."""
    while True:
        try:
            async for item in _told_by_master(node):
                yield item
        except (MasterUnavailable, ForeignMaster, grpc.aio.AioRpcError) as error:
            logger.debug("%s", error)
        except asyncio.CancelledError:
            # gRPC says so, too, when its channel is closed: a node does that when it changes Masters.
            task = asyncio.current_task()
            if task is None or task.cancelling():
                raise
        yield None
        await asyncio.sleep(_RETRY_S)


async def _told_by_master(node: NodeHandle) -> AsyncIterator[GraphSnapshot | GraphChange]:
    """What the Master tells until it goes; a C++ Master, which tells no changes, is asked every second."""
    try:
        async for item in node.client.watch_graph():
            yield item
    except ForeignMaster:
        while True:
            yield await fetch_graph(node.client)
            await asyncio.sleep(_POLL_S)
