"""What a blocking node does with services."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar, cast

from google.protobuf.message import Message

from simple_ros.blocking.service import ServiceClient, ServiceServer, SpinningHandler
from simple_ros.message_queue import DEFAULT_GROUP, CallbackGroup
from simple_ros.msg.interfaces import ServiceType
from simple_ros.service_client import Timeout

if TYPE_CHECKING:
    from simple_ros.blocking.node import BlockingNode

__all__ = ["ServiceMethods"]

RequestT = TypeVar("RequestT", bound=Message)
ResponseT = TypeVar("ResponseT", bound=Message)


class ServiceMethods:
    """Part of `BlockingNode`."""

    @property
    def _as_node(self) -> BlockingNode:
        return cast("BlockingNode", self)

    def advertise_service(
        self,
        name: str,
        service: ServiceType[RequestT, ResponseT] | tuple[type[RequestT], type[ResponseT]] | str,
        handler: Callable[[RequestT], ResponseT],
        *,
        max_concurrent: int = 16,
        queue_limit: int = 1000,
        group: CallbackGroup = DEFAULT_GROUP,
    ) -> ServiceServer[RequestT, ResponseT]:
        """Provide a service; see `simple_ros.aio.NodeHandle.advertise_service`.

        Args:
            name: Its name.
            service: Its type.
            handler: Called with each request in a thread that spins; returns the response.
            max_concurrent: How many calls may wait for such a thread; more wait behind them by priority.
            queue_limit: How many more.
            group: What the handler may run at the same time with, if several threads spin.
        """
        node = self._as_node
        spinning = SpinningHandler(node._executor, name, handler, max_concurrent, group)
        try:
            server = node._loop.run(
                node._node.advertise_service(
                    name,
                    service,
                    spinning,
                    max_concurrent=max_concurrent,
                    queue_limit=queue_limit,
                )
            )
        except BaseException:
            spinning.close()
            raise
        return ServiceServer(node._loop, server, spinning)

    def service_client(
        self,
        name: str,
        service: ServiceType[RequestT, ResponseT] | tuple[type[RequestT], type[ResponseT]] | str,
        *,
        timeout: Timeout = None,
        priority: int = 0,
    ) -> ServiceClient[RequestT, ResponseT]:
        """A client of a service; see `simple_ros.aio.NodeHandle.service_client`."""
        node = self._as_node

        async def made() -> ServiceClient[RequestT, ResponseT]:
            client = node._node.service_client(name, service, timeout=timeout, priority=priority)
            endpoints = node._node.endpoints
            return ServiceClient(
                node._loop,
                node._executor,
                client,
                lambda name: endpoints.service_named(name) is not None,
                node._node.providers.addresses_of,
            )

        return node._loop.run(made())
