"""What a node does with services."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar, cast

from google.protobuf.message import Message

from simple_ros.errors import RegistrationRefused
from simple_ros.msg.interfaces import ServiceType, service_type
from simple_ros.net.transport import UNIX
from simple_ros.rpc import services_pb2 as srv
from simple_ros.service_client import ProviderLinks, ServiceClient, Timeout
from simple_ros.service_server import LaneFinder, ServiceHandler, ServiceServer
from simple_ros.wire.session import EndpointKey, EndpointKind

if TYPE_CHECKING:
    from simple_ros.node import NodeHandle

__all__ = ["ServiceMethods"]

RequestT = TypeVar("RequestT", bound=Message)
ResponseT = TypeVar("ResponseT", bound=Message)


class ServiceMethods:
    """Part of `NodeHandle`."""

    def _init_services(self) -> None:
        self.providers = ProviderLinks(self._local_lanes, by_unix=UNIX in self._as_node.transports)
        self.lanes = LaneFinder(self._as_node.endpoints.service_named)

    def _local_lanes(self, instance_id: str) -> LaneFinder | None:
        peer = self._as_node.local_peer(instance_id)
        return None if peer is None else peer.lanes

    @property
    def _as_node(self) -> NodeHandle:
        return cast("NodeHandle", self)

    async def advertise_service(
        self,
        name: str,
        service: ServiceType[RequestT, ResponseT] | tuple[type[RequestT], type[ResponseT]] | str,
        handler: ServiceHandler[RequestT, ResponseT],
        *,
        max_concurrent: int = 16,
        queue_limit: int = 1000,
    ) -> ServiceServer[RequestT, ResponseT]:
        """Provide a service; returns when the Master knows it (and waits for a Master).

        Args:
            name: Its name; relative to the node's namespace unless it begins with a slash.
            service: Its type: as exported by the message packages (``std_srvs.SetBool``), two message
                classes, or a name.
            handler: Called with each request, returns the response. A plain one runs on the event loop, one
                call after the other; a coroutine function may wait. What it raises is raised at the
                client as `RemoteServiceError`.
            max_concurrent: How many calls of a coroutine handler may be under way.
            queue_limit: How many more may wait; further ones are refused.

        Raises:
            InvalidName: The name breaks the rules.
            UnknownMessageType: A type given by name is not known.
            RegistrationRefused: Another node provides the service.
            ForeignMaster: The Master is C++ simple_ros, which knows no services.
            HandleClosed: The node is closed.
        """
        return await self.provide(
            name, service, handler, max_concurrent=max_concurrent, queue_limit=queue_limit
        )

    async def provide(
        self,
        name: str,
        service: Any,
        handler: Any,
        *,
        max_concurrent: int = 16,
        queue_limit: int = 1000,
        also: tuple[type[Message], ...] = (),
        describe: Callable[[srv.ServiceInfo], None] | None = None,
    ) -> ServiceServer[Any, Any]:
        """As `advertise_service`, for services that are part of something else.

        Args:
            name: As there.
            service: As there.
            handler: As there.
            max_concurrent: As there.
            queue_limit: As there.
            also: Further messages whose definitions the Master is given.
            describe: Adds to what the Master is told.
        """
        node = self._as_node
        registrar = node._live_registrar()
        canonical = node.resolve_name(name, "service")
        kind = service_type(service)
        if node.endpoints.service_named(canonical) is not None:
            raise RegistrationRefused(f"this node provides service {canonical!r} already")
        server: ServiceServer[Any, Any] = ServiceServer(
            node,
            canonical,
            kind,
            handler,
            max_concurrent=max_concurrent,
            queue_limit=queue_limit,
            also=also,
            describe=describe,
        )
        key = _key(server)
        node.endpoints.add(key, server, None)
        try:
            await registrar.register(key)
        except BaseException:
            server.abandon()
            await self.forget_service(server)
            raise
        return server

    def service_client(
        self,
        name: str,
        service: ServiceType[RequestT, ResponseT] | tuple[type[RequestT], type[ResponseT]] | str,
        *,
        timeout: Timeout = None,
        priority: int = 0,
    ) -> ServiceClient[RequestT, ResponseT]:
        """A client of a service, which need not be there yet.

        Args:
            name: Its name.
            service: Its type, as for `advertise_service`.
            timeout: For each call: seconds, an `AdaptiveTimeout`, or None to wait until it is answered or its
                provider is gone.
            priority: Of each call, 0 to 255; higher goes first where calls wait.

        Raises:
            InvalidName: The name breaks the rules.
            UnknownMessageType: A type given by name is not known.
            ConfigError: The priority or the timeout is out of range.
        """
        node = self._as_node
        node._live_registrar()
        canonical = node.resolve_name(name, "service")
        return ServiceClient(node, canonical, service_type(service), timeout, priority)

    async def forget_service(self, server: ServiceServer[Any, Any]) -> None:
        """A service was closed (called by it)."""
        node = self._as_node
        key = _key(server)
        if node.endpoints.remove(key, server) and node._registrar is not None:
            await node._registrar.unregister(key)


def _key(server: ServiceServer[Any, Any]) -> EndpointKey:
    return EndpointKey(EndpointKind.SERVICE, server.name, server.type.name)
