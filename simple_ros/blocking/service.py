"""Services of the blocking face."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, Generic, Self, TypeVar

from google.protobuf.message import Message

from simple_ros.blocking.direct import DirectLink
from simple_ros.errors import ServiceTimeout
from simple_ros.executor import Executor
from simple_ros.message_queue import CallbackGroup, Token
from simple_ros.msg.interfaces import ServiceType
from simple_ros.names import canonical
from simple_ros.net.loop import BackgroundLoop
from simple_ros.service_client import ServiceClient as AsyncServiceClient
from simple_ros.service_client import Timeout
from simple_ros.service_server import ServiceServer as AsyncServiceServer
from simple_ros.service_server import ServiceStatistics
from simple_ros.wire.calls import RttEstimator

__all__ = ["ServiceClient", "ServiceServer", "SpinningHandler"]

RequestT = TypeVar("RequestT", bound=Message)
ResponseT = TypeVar("ResponseT", bound=Message)


class SpinningHandler:
    """Runs a user's handler in a thread that spins, and waits for it on the event loop.

    Args:
        executor: Whose threads.
        name: Of the queue in which calls wait.
        handler: What to call with a request.
        depth: How many calls may wait at once; the caller sees to it.
        group: What the handler may run at the same time with.
    """

    def __init__(
        self,
        executor: Executor,
        name: str,
        handler: Callable[[Any], Any],
        depth: int,
        group: CallbackGroup,
    ) -> None:
        self._queue = executor.queue
        self._handler = handler
        self._token: Token = self._queue.add_subscriber(
            f"simple_ros/calls/{name}", lambda call: call(), depth=depth, group=group
        )

    async def __call__(self, *arguments: Any) -> Any:
        """Call the handler; its exceptions come out here."""
        loop = asyncio.get_running_loop()
        future: asyncio.Future[Any] = loop.create_future()

        def settle(result: Any, error: BaseException | None) -> None:
            if future.done():
                return
            if error is None:
                future.set_result(result)
            else:
                future.set_exception(error)

        def work() -> None:
            if future.cancelled():
                return
            try:
                result = self._handler(*arguments)
            except Exception as error:
                loop.call_soon_threadsafe(settle, None, error)
            else:
                loop.call_soon_threadsafe(settle, result, None)

        self._queue.deliver(self._token, (work,))
        return await future

    def close(self) -> None:
        """Call no more."""
        self._queue.remove_subscriber(self._token)


class ServiceServer(Generic[RequestT, ResponseT]):
    """Answers the calls of one service in a thread that spins. Made by `NodeHandle.advertise_service`."""

    def __init__(
        self,
        loop: BackgroundLoop,
        server: AsyncServiceServer[RequestT, ResponseT],
        handler: SpinningHandler,
    ) -> None:
        self._loop = loop
        self._server = server
        self._handler = handler

    @property
    def name(self) -> str:
        """Canonical name of the service."""
        return self._server.name

    @property
    def type(self) -> ServiceType[RequestT, ResponseT]:
        """Its messages."""
        return self._server.type

    @property
    def statistics(self) -> ServiceStatistics:
        """Counters so far."""
        return self._server.statistics

    def close(self) -> None:
        """Stop providing the service; calls under way are refused."""
        self._loop.run(self._server.close())
        self._handler.close()

    unregister = close

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return repr(self._server)


class ServiceClient(Generic[RequestT, ResponseT]):
    """Calls one service. Made by `NodeHandle.service_client`. May be used from any thread."""

    def __init__(
        self,
        loop: BackgroundLoop,
        executor: Executor,
        client: AsyncServiceClient[RequestT, ResponseT],
        is_own: Callable[[str], bool],
        addresses_of: Callable[[Any], list[str]],
    ) -> None:
        self._addresses_of = addresses_of
        self._direct: DirectLink | None = None
        self._direct_lock = threading.Lock()
        self._is_closed = False
        self._loop = loop
        self._executor = executor
        self._client = client
        self._is_own = is_own

    @property
    def name(self) -> str:
        """Canonical name of the service."""
        return self._client.name

    @property
    def type(self) -> ServiceType[RequestT, ResponseT]:
        """Its messages."""
        return self._client.type

    @property
    def rtt(self) -> RttEstimator:
        """Round trips measured so far."""
        return self._client.rtt

    def call(
        self,
        request: RequestT,
        *,
        timeout: Timeout | str = "default",
        priority: int | None = None,
    ) -> ResponseT:
        """One call; see `simple_ros.aio.ServiceClient.call`.

        Raises:
            RuntimeError: It would wait for itself: the only thread that spins calls a service of its own
                process. Use `call_async`, or ``spin(threads=2)`` and a callback group.
        """
        if self._is_own(self.name) and self._executor.is_only_thread(threading.get_ident()):
            raise RuntimeError(
                f"service {self.name!r} is provided by this process, and the only thread that could "
                "answer is the one that asks; use call_async, or spin(threads=2) and another group"
            )
        if self._loop.is_current or not self._direct_lock.acquire(blocking=False):
            # Somebody else is calling: the background loop takes any number at a time.
            return self._loop.run(self._client.call(request, timeout=timeout, priority=priority))
        try:
            return self._call_directly(request, timeout, priority)
        finally:
            self._direct_lock.release()

    def _call_directly(
        self, request: RequestT, timeout: Timeout | str, priority: int | None
    ) -> ResponseT:
        client = self._client
        client.check_open()
        payload, level, limit = (
            client.serialised(request),
            client.level(priority),
            client.limit_s(timeout),
        )
        begun = time.monotonic()
        link = self._direct
        if link is None or not link.is_up or self._is_closed:
            link = self._direct = self._dialled(limit)
            if limit is not None:
                limit = max(limit - (time.monotonic() - begun), 0.001)
        try:
            response: ResponseT = link.call(payload, client.type.response.FromString, limit, level)
        except ServiceTimeout:
            client.rtt.timed_out()
            raise
        client.rtt.measured(time.monotonic() - begun)
        return response

    def _dialled(self, limit: float | None) -> DirectLink:
        try:
            info = self._loop.run(self._client.provider(), limit)
        except TimeoutError as error:
            if isinstance(error, ServiceTimeout):
                raise
            raise ServiceTimeout(self.name, "its provider could not be found in time") from None
        node = canonical(info.node_info.node_name)
        return DirectLink(node, self.name, self._addresses_of(info.node_info))

    def call_async(
        self,
        request: RequestT,
        *,
        timeout: Timeout | str = "default",
        priority: int | None = None,
        callback: Callable[[Future[ResponseT]], object] | None = None,
    ) -> Future[ResponseT]:
        """Begin a call and go on.

        Args:
            request: What to ask.
            timeout: As for `call`.
            priority: As for `call`.
            callback: Called with the future, once it is done, in a thread that spins.
        """
        future = self._loop.submit(self._client.call(request, timeout=timeout, priority=priority))
        if callback is not None:
            future.add_done_callback(lambda done: self._executor.call_soon(lambda: callback(done)))
        return future

    def wait_for_service(self, timeout: float | None = None) -> None:
        """Return when some node provides the service and can be called.

        Raises:
            TimeoutError: Not within ``timeout`` seconds.
        """
        self._loop.run(self._client.wait_for_service(timeout))

    def close(self) -> None:
        """Call no more."""
        self._is_closed = True
        if self._direct is not None:
            self._direct.close()
        self._loop.run(self._client.close())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return repr(self._client)
