"""The provider's side of services.

A plain handler is called straight from the read of the socket, in the order in which requests arrive (of
those that arrive together, the highest priority first). A coroutine handler runs in tasks, up to
``max_concurrent`` at a time; the others wait, the highest priority first, and are given up when their
time is over or the client takes them back.
"""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from struct import Struct
from typing import TYPE_CHECKING, Any, Generic, Protocol, Self, TypeVar

from google.protobuf.message import DecodeError, Message

from simple_ros.callbacks import CALLBACK_ERRORS, CallbackGuard, is_async
from simple_ros.msg.interfaces import ServiceType
from simple_ros.net.caller import Coalescer
from simple_ros.net.feeder import Source
from simple_ros.rpc import services_pb2 as srv
from simple_ros.wire.calls import (
    CANCEL_TYPE,
    REQUEST_TYPE,
    RESPONSE_TYPE,
    CallQueue,
    Request,
    Status,
    pack_response,
    unpack_cancel,
    unpack_request,
)
from simple_ros.wire.framing import Payload, encode_header

if TYPE_CHECKING:
    from simple_ros.node import NodeHandle

__all__ = ["LaneFinder", "ServiceHandler", "ServiceServer", "ServiceStatistics"]

logger = logging.getLogger(__name__)

RequestT = TypeVar("RequestT", bound=Message)
ResponseT = TypeVar("ResponseT", bound=Message)
ServiceHandler = (
    Callable[[RequestT], ResponseT] | Callable[[RequestT], Coroutine[Any, Any, ResponseT]]
)

_pack_u32 = Struct(">I").pack


class Answering(Protocol):
    """A connection that can be answered on."""

    def write(self, data: bytes) -> None:
        """Send."""


@dataclass(frozen=True, slots=True)
class ServiceStatistics:
    """Counters since the service was advertised.

    Attributes:
        calls: Requests that arrived.
        errors: Exceptions of the handler.
        expired: Requests given up because their time was over or the client took them back.
        refused: Requests that could not be read, or came while too many waited.
        running: Coroutine handlers at work now.
        waiting: Requests that wait now.
    """

    calls: int
    errors: int
    expired: int
    refused: int
    running: int
    waiting: int


@dataclass(slots=True, eq=False)
class _Call:
    """A request under way."""

    lane: ServiceLane
    number: int
    message: Any
    due: float
    task: asyncio.Task[None] | None = None
    given_up: bool = False


class ServiceServer(Generic[RequestT, ResponseT]):
    """Answers the calls of one service. Made by `NodeHandle.advertise_service`.

    It lives until closed: the node holds it.

    Attributes:
        name: Canonical name of the service.
        type: Its messages.
    """

    def __init__(
        self,
        node: NodeHandle,
        name: str,
        kind: ServiceType[RequestT, ResponseT],
        handler: ServiceHandler[RequestT, ResponseT],
        *,
        max_concurrent: int,
        queue_limit: int,
        also: tuple[type[Message], ...] = (),
        describe: Callable[[srv.ServiceInfo], None] | None = None,
    ) -> None:
        self.name = name
        self.type = kind
        self.definitions = (*kind.classes, *also)
        self._describe = describe
        self._node = node
        self._handler: Any = handler
        self._is_async = is_async(handler)
        self._max_concurrent = max_concurrent
        self._waiting: CallQueue[_Call] = CallQueue(queue_limit)
        self._running: set[_Call] = set()
        self._guard = CallbackGuard(f"service {name!r}")
        self._loop = asyncio.get_running_loop()
        self._closed = False
        self._calls = self._expired = self._refused = 0

    def info(self) -> srv.ServiceInfo:
        """What the Master is told."""
        info = srv.ServiceInfo(
            name=self.name,
            request_type=self.type.request.DESCRIPTOR.full_name,
            response_type=self.type.response.DESCRIPTOR.full_name,
        )
        if self._describe is not None:
            self._describe(info)
        return info

    @property
    def statistics(self) -> ServiceStatistics:
        """Counters so far."""
        return ServiceStatistics(
            self._calls,
            self._guard.errors,
            self._expired,
            self._refused,
            len(self._running),
            len(self._waiting),
        )

    # -- requests ------------------------------------------------------------------------------

    @property
    def is_closed(self) -> bool:
        """Whether it answers no more."""
        return self._closed

    def take(self, lane: ServiceLane, request: Request) -> None:
        """A request has arrived (called by its lane)."""
        self._calls += 1
        try:
            message = self.type.request.FromString(request.payload)  # type: ignore[arg-type]
        except DecodeError as error:
            self._refused += 1
            lane.refuse(request.id, Status.MALFORMED, "DecodeError", str(error))
            return
        due = math.inf if request.timeout_s is None else self._loop.time() + request.timeout_s
        call = _Call(lane, request.id, message, due)
        if not self._is_async:
            self._run_plain(call)
            return
        if not self._waiting.push(call, request.priority):
            self._refused += 1
            lane.refuse(request.id, Status.OVERLOADED, "QueueFull", "")
            return
        lane.calls[call.number] = call
        self._start_next()

    def _run_plain(self, call: _Call) -> None:
        try:
            answer = self._checked(self._handler(call.message))
        except CALLBACK_ERRORS as error:
            self._raised(call, error)
        else:
            call.lane.answer(call.number, answer)

    def _checked(self, response: Any) -> bytes:
        if isinstance(response, self.type.response):
            return response.SerializeToString()
        wanted = self.type.response.DESCRIPTOR.full_name
        got = getattr(getattr(response, "DESCRIPTOR", None), "full_name", type(response).__name__)
        if got == wanted:
            return bytes(response.SerializeToString())
        raise TypeError(f"the handler of {self.name!r} returned {got}, not {wanted}")

    def _raised(self, call: _Call, error: BaseException) -> None:
        self._guard.failed(error)
        call.lane.refuse(call.number, Status.RAISED, type(error).__name__, str(error))

    # -- coroutine handlers --------------------------------------------------------------------

    def _start_next(self) -> None:
        while len(self._waiting) and len(self._running) < self._max_concurrent:
            call = self._waiting.pop()
            if call.given_up:
                continue
            if call.due <= self._loop.time():
                self._expire(call)
                continue
            self._running.add(call)
            call.task = self._loop.create_task(self._run(call), name=f"service {self.name}")

    async def _run(self, call: _Call) -> None:
        try:
            async with asyncio.timeout_at(None if call.due == math.inf else call.due) as limit:
                answer = self._checked(await self._handler(call.message))
            call.lane.answer(call.number, answer)
        except asyncio.CancelledError:
            if not call.given_up:
                raise
        except Exception as error:
            if limit.expired():
                self._expire(call)
            else:
                self._raised(call, error)
        finally:
            call.lane.calls.pop(call.number, None)
            self._running.discard(call)
            if not self._closed:
                self._start_next()

    def _expire(self, call: _Call) -> None:
        self._expired += 1
        call.lane.calls.pop(call.number, None)
        call.lane.refuse(call.number, Status.EXPIRED, "TimeoutError", "")

    def give_up(self, call: _Call) -> None:
        """Nobody waits for the answer any more (called by the lane)."""
        call.given_up = True
        self._expired += 1
        if call.task is not None:
            call.task.cancel()

    # -- the end -------------------------------------------------------------------------------

    async def close(self) -> None:
        """Stop providing the service: coroutine handlers are cancelled, further calls are refused."""
        if not self._closed:
            self.abandon(asyncio.current_task())
            await self._node.forget_service(self)

    unregister = close

    def abandon(self, caller: asyncio.Task[Any] | None = None) -> None:
        """End at once, telling nobody (called by the node); cancels no task that is the caller."""
        self._closed = True
        while len(self._waiting):
            call = self._waiting.pop()
            call.lane.refuse(call.number, Status.UNKNOWN_SERVICE, "", "")
        for call in list(self._running):
            call.lane.refuse(call.number, Status.UNKNOWN_SERVICE, "", "")
            call.given_up = True
            if call.task is not None and call.task is not caller:
                call.task.cancel()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    def __repr__(self) -> str:
        state = "closed" if self._closed else f"{self._calls} calls"
        return f"<ServiceServer {self.name} [{self.type.name}] {state}>"


class ServiceLane:
    """The calls of one client connection to one service.

    Attributes:
        calls: Those a coroutine handler works on, or will, by the client's number.
    """

    def __init__(
        self, link: Answering, name: str, server: Callable[[], ServiceServer[Any, Any] | None]
    ) -> None:
        self.calls: dict[int, _Call] = {}
        self._server = server
        self._known: ServiceServer[Any, Any] | None = None
        self._out = Coalescer(link.write)
        self._header = encode_header(name, RESPONSE_TYPE)
        self._batch: list[bytes] | None = None
        self.take_lone: Callable[[bytes], object] | None = self._take_one

    def _take_one(self, data: bytes) -> None:
        try:
            request = unpack_request(data)
        except ValueError as error:
            logger.warning("dropping %s", error)
        else:
            self._take(request)

    def offer(self, payloads: list[Payload], resume: Callable[[], None], *, force: bool) -> int:  # noqa: ARG002
        """Requests; see `simple_ros.router.Lane`."""
        requests = []
        for data in payloads:
            try:
                requests.append(unpack_request(data))
            except ValueError as error:
                logger.warning("dropping %s", error)
        if len(requests) > 1 and any(request.priority for request in requests):
            requests.sort(key=lambda request: -request.priority)
        self._batch = []
        try:
            for request in requests:
                self._take(request)
        finally:
            batch, self._batch = self._batch, None
            if batch:
                self._out.add(b"".join(batch))
        return len(payloads)

    def _take(self, request: Request) -> None:
        server = self._known
        if server is None or server.is_closed:
            # Finding it goes through all that the node publishes and provides.
            server = self._known = self._server()
        if server is None:
            self.refuse(request.id, Status.UNKNOWN_SERVICE, "", "")
        else:
            server.take(self, request)

    def answer(self, number: int, payload: bytes, status: int = Status.OK) -> None:
        """Send an answer."""
        data = pack_response(number, status, payload)
        frame = self._header + _pack_u32(len(data)) + data
        if self._batch is not None:
            self._batch.append(frame)
        else:
            self._out.add(frame)

    def refuse(self, number: int, status: Status, kind: str, message: str) -> None:
        """Send why there is no answer."""
        error = srv.ServiceError(type=kind, message=message)
        self.answer(number, error.SerializeToString(), status)

    def take_back(self, number: int) -> None:
        """The client no longer waits."""
        call = self.calls.pop(number, None)
        server = self._server()
        if call is not None and server is not None:
            server.give_up(call)

    def oversized(self, size: int) -> None:
        """A request was too large; it was never read, so its number is not known."""
        logger.warning("dropping a service request of %d bytes: over the limit", size)

    def link_ended(self, link: Source) -> None:  # noqa: ARG002
        """The client is gone."""
        for number in list(self.calls):
            self.take_back(number)


class LocalLane(ServiceLane):
    """One call from a client on the same event loop."""

    def __init__(
        self,
        server: Callable[[], ServiceServer[Any, Any] | None],
        future: asyncio.Future[tuple[int, bytes]],
    ) -> None:
        self.calls = {}
        self._server = server
        self._known = None
        self._future = future

    def request(self, payload: bytes, timeout_s: float | None, priority: int) -> None:
        """Begin the call."""
        self._take(Request(0, timeout_s, priority, memoryview(payload)))

    def answer(self, number: int, payload: bytes, status: int = Status.OK) -> None:  # noqa: ARG002
        """The answer is there."""
        if not self._future.done():
            self._future.set_result((status, payload))


class _CancelLane:
    """Frames that take requests back."""

    take_lone: Callable[[bytes], object] | None = None

    def __init__(self, lane: ServiceLane) -> None:
        self._lane = lane

    def offer(self, payloads: list[Payload], resume: Callable[[], None], *, force: bool) -> int:  # noqa: ARG002
        for data in payloads:
            try:
                self._lane.take_back(unpack_cancel(data))
            except ValueError as error:
                logger.warning("dropping %s", error)
        return len(payloads)

    def oversized(self, size: int) -> None:
        logger.warning("dropping a service cancel of %d bytes", size)

    def link_ended(self, link: Source) -> None:
        """The lane of the requests is told as well."""


class LaneFinder:
    """Finds the lanes of service frames for the router of a node.

    Args:
        server_named: The service of that name that the node provides now.

    Attributes:
        is_closed: Whether the node has ended.
    """

    def __init__(self, server_named: Callable[[str], ServiceServer[Any, Any] | None]) -> None:
        self._server_named = server_named
        self._lanes: dict[tuple[Source, str], ServiceLane] = {}
        self.is_closed = False

    def find(self, link: Source, name: str, frame_type: str) -> ServiceLane | _CancelLane | None:
        """Where frames of a type go; None if they have nothing to do with services."""
        if frame_type not in (REQUEST_TYPE, CANCEL_TYPE):
            return None
        lane = self._lanes.get((link, name))
        if lane is None:
            lane = ServiceLane(link, name, lambda: self._server_named(name))  # type: ignore[arg-type]
            self._lanes[link, name] = lane
        return lane if frame_type == REQUEST_TYPE else _CancelLane(lane)

    def local(self, name: str, future: asyncio.Future[tuple[int, bytes]]) -> LocalLane:
        """A lane for one call from the same event loop."""
        return LocalLane(lambda: self._server_named(name), future)

    def link_ended(self, link: Source) -> None:
        """Forget a link's lanes."""
        for key in [key for key in self._lanes if key[0] is link]:
            del self._lanes[key]
