"""The client's side of services."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Generic, Self, TypeVar

from google.protobuf.message import Message

from simple_ros.errors import (
    ConfigError,
    HandleClosed,
    ServiceTimeout,
    ServiceTypeMismatch,
    ServiceUnavailable,
)
from simple_ros.msg.interfaces import ServiceType
from simple_ros.names import canonical
from simple_ros.net.addresses import join_address
from simple_ros.net.caller import ProviderLink, failure_of
from simple_ros.rpc import methods
from simple_ros.rpc import services_pb2 as srv
from simple_ros.service_server import LaneFinder
from simple_ros.wire.calls import AdaptiveTimeout, RttEstimator, Status

if TYPE_CHECKING:
    from simple_ros.node import NodeHandle

__all__ = ["ProviderLinks", "ServiceClient", "Timeout"]

RequestT = TypeVar("RequestT", bound=Message)
ResponseT = TypeVar("ResponseT", bound=Message)
Timeout = float | AdaptiveTimeout | None


class ServiceClient(Generic[RequestT, ResponseT]):
    """Calls one service. Made by `NodeHandle.service_client`.

    The provider is found through the Master at the first call and dialled directly; all clients of a node
    share one connection to each provider.

    Attributes:
        name: Canonical name of the service.
        type: Its messages.
        rtt: Round trips measured so far, handlers' time included.
    """

    def __init__(
        self,
        node: NodeHandle,
        name: str,
        kind: ServiceType[RequestT, ResponseT],
        timeout: Timeout,
        priority: int,
    ) -> None:
        self.name = name
        self.type = kind
        self.rtt = RttEstimator()
        self._node = node
        self._timeout = checked_timeout(timeout)
        self._priority = checked_priority(priority)
        self._link: ProviderLink | LocalProvider | None = None
        self._closed = False
        self._loop = asyncio.get_running_loop()

    async def call(
        self,
        request: RequestT,
        *,
        timeout: Timeout | str = "default",
        priority: int | None = None,
    ) -> ResponseT:
        """One call. Any number may be under way.

        Args:
            request: What to ask.
            timeout: Seconds, an `AdaptiveTimeout`, or None to wait for ever; the client's own if not given.
                The time to find and dial the provider counts.
            priority: 0 to 255, higher goes first where calls wait; the client's own if None.

        Raises:
            TypeError: The request is of another type than the service's.
            ServiceUnavailable: Nobody provides it, or the provider died before it answered.
            ServiceTimeout: No answer in time; the provider was told to stop.
            RemoteServiceError: The handler raised an exception.
            ServiceTypeMismatch: The service has another type.
            MasterUnavailable: The provider is not known yet and no Master answers.
            HandleClosed: The client or its node is closed.
        """
        limit = self.limit_s(timeout)
        begun = self._loop.time()
        payload = self.serialised(request)
        level = self.level(priority)
        link = self._link
        if link is None or not link.is_up or self._closed:
            link = await self._connected(limit)
            if limit is not None:
                limit = max(limit - (self._loop.time() - begun), 0.001)
        try:
            response: ResponseT = await link.call(
                self.name, payload, self.type.response.FromString, limit, level
            )
        except ServiceTimeout:
            self.rtt.timed_out()
            raise
        self.rtt.measured(self._loop.time() - begun)
        return response

    def serialised(self, request: RequestT) -> bytes:
        """A request as bytes.

        Raises:
            TypeError: It is of another type than the service's.
        """
        if request.__class__ is not self.type.request:
            given = getattr(getattr(request, "DESCRIPTOR", None), "full_name", None)
            if given != self.type.request.DESCRIPTOR.full_name:
                raise TypeError(
                    f"service {self.name!r} takes {self.type.request.DESCRIPTOR.full_name}, "
                    f"not {given or type(request).__name__}"
                )
        return request.SerializeToString()

    async def _connected(self, limit_s: float | None) -> ProviderLink | LocalProvider:
        if self._closed:
            raise HandleClosed(f"client of service {self.name!r}")
        try:
            async with asyncio.timeout(limit_s):
                info = await self._found()
                self._link = await self._node.providers.link_to(info)
                return self._link
        except TimeoutError:
            raise ServiceTimeout(self.name, "its provider could not be reached in time") from None

    async def provider(self) -> srv.ServiceInfo:
        """Who provides the service now, as the Master says.

        Raises:
            ServiceUnavailable: Nobody.
            ServiceTypeMismatch: It has another type.
            MasterUnavailable: No Master answers.
            HandleClosed: The client is closed.
        """
        self.check_open()
        return await self._found()

    def check_open(self) -> None:
        """Raise `HandleClosed` or `NodeNameTaken` if nothing can be called any more."""
        if self._closed or self._node.is_closed:
            raise self._node.failure or HandleClosed(f"client of service {self.name!r}")

    def limit_s(self, timeout: Timeout | str) -> float | None:
        """How long a call may take, in seconds, with a timeout as given to `call`."""
        policy = self._timeout if isinstance(timeout, str) else timeout
        return self.rtt.timeout_s(policy) if isinstance(policy, AdaptiveTimeout) else policy

    def level(self, priority: int | None) -> int:
        """The priority of a call, as given to `call`."""
        return self._priority if priority is None else checked_priority(priority)

    async def _found(self) -> srv.ServiceInfo:
        request = srv.FindServiceRequest(name=self.name)
        answer = await self._node.client.call(methods.FIND_SERVICE, request)
        if not answer.found:
            raise ServiceUnavailable(self.name, "no node provides it")
        return self._checked(answer.service)

    def _checked(self, info: srv.ServiceInfo) -> srv.ServiceInfo:
        wanted = tuple(item.DESCRIPTOR.full_name for item in self.type.classes)
        if (info.request_type, info.response_type) != wanted:
            found = f"{info.request_type} -> {info.response_type}"
            node = canonical(info.node_info.node_name)
            raise ServiceTypeMismatch(self.name, " -> ".join(wanted), found, node)
        return info

    async def wait_for_service(self, timeout: float | None = None) -> None:
        """Return when some node provides the service and can be called.

        Raises:
            TimeoutError: Not within ``timeout`` seconds.
            ServiceTypeMismatch: It has another type.
        """
        request = srv.FindServiceRequest(name=self.name, wait=True)
        async with asyncio.timeout(timeout):
            while True:
                await self._node.wait_for_master()
                try:
                    answer = await self._node.client.call(methods.FIND_SERVICE, request, None)
                    self._link = await self._node.providers.link_to(self._checked(answer.service))
                    return
                except (ServiceUnavailable, ConnectionError):
                    # A Master that went away, or a provider that is on its way out.
                    await asyncio.sleep(_LOOK_AGAIN_S)

    async def close(self) -> None:
        """Call no more; calls under way go on."""
        self._closed = True

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    def __repr__(self) -> str:
        return f"<ServiceClient {self.name} [{self.type.name}]>"


_LOOK_AGAIN_S = 0.1


def checked_priority(priority: int) -> int:
    """A priority as it is.

    Raises:
        ConfigError: It is not between 0 and 255.
    """
    if not 0 <= priority <= 255:
        raise ConfigError(f"a priority is between 0 and 255, not {priority}")
    return priority


def checked_timeout(timeout: Timeout) -> Timeout:
    """A client's timeout as it is.

    Raises:
        ConfigError: It is negative, or no number.
    """
    if timeout is not None and not isinstance(timeout, AdaptiveTimeout) and not timeout >= 0:
        raise ConfigError(f"a timeout is 0 s or more, or None, not {timeout}")
    return timeout


class LocalProvider:
    """A provider on the same event loop: called without a connection, with messages of its own."""

    def __init__(self, node: str, lanes: LaneFinder) -> None:
        self.node = node
        self._lanes = lanes

    @property
    def is_up(self) -> bool:
        """Whether its node is still open."""
        return not self._lanes.is_closed

    async def call(
        self,
        service: str,
        payload: bytes,
        parse: Callable[[Any], Any],
        timeout_s: float | None,
        priority: int,
    ) -> Any:
        """As `ProviderLink.call`."""
        loop = asyncio.get_running_loop()
        future: asyncio.Future[tuple[int, bytes]] = loop.create_future()
        lane = self._lanes.local(service, future)
        try:
            async with asyncio.timeout(timeout_s):
                lane.request(payload, timeout_s, priority)
                status, answer = await future
        except TimeoutError:
            lane.take_back(0)
            raise ServiceTimeout(service, f"no answer from node {self.node!r} in time") from None
        except asyncio.CancelledError:
            lane.take_back(0)
            raise
        if status != Status.OK:
            raise failure_of(service, self.node, status, answer)
        return parse(answer)


class ProviderLinks:
    """The connections of one node to providers of services.

    Args:
        local_lanes: Finds the lanes of a node of this event loop by its instance id.
        by_unix: Whether to use Unix sockets on this host.
    """

    def __init__(self, local_lanes: Callable[[str], LaneFinder | None], *, by_unix: bool) -> None:
        self._by_unix = by_unix
        self._local_lanes = local_lanes
        self._links: dict[str, ProviderLink] = {}
        self._dialling: dict[str, asyncio.Task[ProviderLink]] = {}

    async def link_to(self, info: srv.ServiceInfo) -> ProviderLink | LocalProvider:
        """A connection to the provider of a service.

        Raises:
            ServiceUnavailable: It does not answer.
        """
        provider = info.node_info
        lanes = self._local_lanes(provider.instance_id)
        if lanes is not None:
            return LocalProvider(canonical(provider.node_name), lanes)
        key = f"{provider.instance_id}@{provider.ip}:{provider.port}"
        link = self._links.get(key)
        if link is not None and link.is_up:
            return link
        task = self._dialling.get(key)
        if task is None:
            task = asyncio.create_task(self._dialled(key, provider), name=f"dial {key}")
            self._dialling[key] = task
            task.add_done_callback(lambda _: self._dialling.pop(key, None))
        try:
            return await asyncio.shield(task)
        except OSError as error:
            node = canonical(provider.node_name)
            reason = f"node {node!r} provides it but does not answer ({error})"
            raise ServiceUnavailable(info.name, reason) from None

    def addresses_of(self, provider: Any) -> list[str]:
        """Where a provider can be dialled: by a Unix socket first, if this node uses them."""
        by_unix = [item for item in provider.addresses if item.startswith("unix://")]
        by_tcp = [item for item in provider.addresses if "://" not in item]
        own = join_address(provider.ip, provider.port)
        return [*(by_unix if self._by_unix else ()), own, *by_tcp]

    async def _dialled(self, key: str, provider: Any) -> ProviderLink:
        addresses = self.addresses_of(provider)

        def lost(_: ProviderLink) -> None:
            self._links.pop(key, None)

        link = ProviderLink(canonical(provider.node_name), addresses, lost)
        await link.dial()
        self._links[key] = link
        return link

    def close(self) -> None:
        """End all; calls under way fail."""
        for task in list(self._dialling.values()):
            task.cancel()
        for link in list(self._links.values()):
            link.close()
