"""Services as clients see them: in JSON, whatever they are made of."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import grpc

from simple_ros.errors import MasterUnavailable, SimpleRosError, UnknownMessageType
from simple_ros.foxglove.client import Client
from simple_ros.foxglove.errors import one_line
from simple_ros.foxglove.events import Called
from simple_ros.foxglove.frames import Schema
from simple_ros.foxglove.graph_model import shown
from simple_ros.foxglove.json_input import json_of, message_of
from simple_ros.foxglove.json_schema import json_schema
from simple_ros.foxglove.server import FoxgloveServer
from simple_ros.foxglove.type_book import TypeBook
from simple_ros.graph import GraphService
from simple_ros.msg.interfaces import ServiceType
from simple_ros.node import NodeHandle

__all__ = ["DEFAULT_TIMEOUT_S", "Services", "message_names"]

logger = logging.getLogger(__name__)

DEFAULT_TIMEOUT_S = 60.0


def message_names(service: GraphService) -> tuple[str, str]:
    """Names of the request's and the response's type."""
    request, arrow, response = service.type_name.partition(" -> ")
    if arrow:
        return request, response
    return f"{service.type_name}Request", f"{service.type_name}Response"


def _is_hidden(name: str) -> bool:
    """Whether it serves something else, as the services of an action do."""
    return any(part.startswith("_") for part in name.split("/"))


@dataclass(frozen=True, slots=True)
class _Offered:
    id: int
    name: str
    type_name: str
    kind: ServiceType[Any, Any]


class Services:
    """Keeps the services of a server like those of a graph, and calls them.

    Args:
        node: Calls.
        server: Offers.
        types: Knows types.
        timeout_s: After how many seconds a call has failed.
    """

    def __init__(
        self, node: NodeHandle, server: FoxgloveServer, types: TypeBook, timeout_s: float
    ) -> None:
        self._node = node
        self._server = server
        self._types = types
        self._timeout_s = timeout_s
        self._offered: dict[str, _Offered] = {}
        self._calls: dict[asyncio.Task[None], Client] = {}
        self.unknown: set[str] = set()

    async def sync(self, services: Mapping[str, GraphService]) -> None:
        """Offer just these services, given by canonical name."""
        wanted = {name: item for name, item in services.items() if not _is_hidden(name)}
        gone = [
            item
            for name, item in self._offered.items()
            if name not in wanted or wanted[name].type_name != item.type_name
        ]
        self._server.remove_services(item.id for item in gone)
        for item in gone:
            del self._offered[item.name]
        self.unknown = set()
        for name, service in wanted.items():
            if name not in self._offered:
                await self._offer(name, service)

    async def _offer(self, name: str, service: GraphService) -> None:
        try:
            request, response = [await self._types.find(kind) for kind in message_names(service)]
        except (UnknownMessageType, MasterUnavailable, grpc.aio.AioRpcError) as error:
            logger.debug("service %s is not offered: %s", name, error)
            self.unknown.add(name)
            return
        made = self._server.add_service(
            shown(name),
            service.type_name,
            *(
                Schema(known.name, json_schema(known.message_class.DESCRIPTOR))
                for known in (request, response)
            ),
        )
        kind = ServiceType(request.message_class, response.message_class)
        self._offered[name] = _Offered(made.id, name, service.type_name, kind)

    def call(self, client: Client, call: Called) -> None:
        """A client calls a service."""
        task = asyncio.get_running_loop().create_task(self._call(client, call))
        self._calls[task] = client
        task.add_done_callback(lambda done: self._calls.pop(done, None))

    async def _call(self, client: Client, call: Called) -> None:
        offered = next((i for i in self._offered.values() if i.id == call.service.id), None)
        try:
            if offered is None:
                client.session.fail(call, "it has gone")
                return
            request = message_of(offered.kind.request, call.payload)
            async with self._node.service_client(f"/{offered.name}", offered.kind) as service:
                response = await service.call(request, timeout=self._timeout_s)
            client.session.answer(call, json_of(response))
        except SimpleRosError as error:
            client.session.fail(call, one_line(error))
        except Exception as error:
            # Whatever it is, the client is answered.
            logger.exception("call of service %r", call.service.name)
            client.session.fail(call, f"{type(error).__name__}: {one_line(error)}")
        finally:
            client.process()

    def forget(self, client: Client) -> None:
        """A client has gone, and with it its calls."""
        for task, caller in list(self._calls.items()):
            if caller is client:
                task.cancel()

    async def end(self) -> None:
        """Call nothing more."""
        tasks = list(self._calls)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
