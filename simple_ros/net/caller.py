"""The client's side of service calls: one connection to each provider, calls pipelined on it."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from struct import Struct
from typing import Any, NamedTuple, cast

from google.protobuf.message import DecodeError

from simple_ros.errors import (
    RemoteServiceError,
    ServiceCallError,
    ServiceTimeout,
    ServiceUnavailable,
)
from simple_ros.net.addresses import connection_state, keep_alive, split_address
from simple_ros.net.inbound_stream import take_connection
from simple_ros.net.stream import connected_tcp
from simple_ros.net.unix import connected_unix
from simple_ros.rpc import services_pb2 as srv
from simple_ros.wire.calls import (
    CANCEL_TYPE,
    REQUEST_TYPE,
    Deadlines,
    Status,
    pack_cancel,
    pack_request,
    unpack_response,
)
from simple_ros.wire.framing import (
    DEFAULT_MAX_MESSAGE_BYTES,
    FrameDecoder,
    Payload,
    encode_frame,
    encode_header,
)

__all__ = ["Coalescer", "ProviderLink", "failure_of"]

logger = logging.getLogger(__name__)

_pack_u32 = Struct(">I").pack
_DIAL_TIMEOUT_S = 5.0
_CHECK_EVERY_S = 2.0
_BURST_S = 100e-6


class Coalescer:
    """Writes what comes alone at once, and what comes in a burst together at the end of the tick."""

    def __init__(self, write: Callable[[bytes], None]) -> None:
        self._write = write
        self._loop = asyncio.get_running_loop()
        self._waiting: list[bytes] = []
        self._scheduled = False
        self._sent_at = -1.0

    def add(self, data: bytes) -> None:
        """Write soon."""
        if not self._scheduled:
            now = self._loop.time()
            if now - self._sent_at > _BURST_S:
                self._sent_at = now
                self._write(data)
                return
            self._scheduled = True
            self._loop.call_soon(self.flush)
        self._waiting.append(data)

    def flush(self) -> None:
        """Write what waits."""
        self._scheduled = False
        if self._waiting:
            waiting, self._waiting = self._waiting, []
            self._write(b"".join(waiting))


class _Pending(NamedTuple):
    service: str
    future: asyncio.Future[Any]
    parse: Callable[[Any], Any]


def failure_of(service: str, node: str, status: int, payload: bytes) -> ServiceCallError:
    """The error a client raises for a call that did not succeed."""
    try:
        error = srv.ServiceError.FromString(payload)
    except DecodeError:
        error = srv.ServiceError()
    if status == Status.RAISED:
        return RemoteServiceError(service, node, error.type, error.message)
    if status == Status.EXPIRED:
        return ServiceTimeout(service, "the provider gave up: its time was over")
    reasons = {
        Status.UNKNOWN_SERVICE: "does not provide it any more",
        Status.OVERLOADED: "has too many calls waiting",
        Status.MALFORMED: "could not read the request",
    }
    reason = reasons.get(Status(status) if status in list(Status) else Status.MALFORMED, "")
    detail = f" ({error.message})" if error.message else ""
    return ServiceUnavailable(service, f"node {node!r} {reason}{detail}")


class ProviderLink(asyncio.BufferedProtocol):
    """A connection to one node that provides services.

    Args:
        node: Its name, for people.
        addresses: ``host:port``, or ``unix://...``, tried in turn.
        on_lost: Called when the connection has ended.

    Attributes:
        room: Where the next bytes go, if that is known already.
    """

    def __init__(
        self, node: str, addresses: Sequence[str], on_lost: Callable[[ProviderLink], None]
    ) -> None:
        self.node = node
        self._addresses = addresses
        self._on_lost = on_lost
        self._loop = asyncio.get_running_loop()
        self._decoder = FrameDecoder(DEFAULT_MAX_MESSAGE_BYTES)
        self.room: memoryview | None = None
        self._transport: asyncio.Transport | None = None
        self._pending: dict[int, _Pending] = {}
        self._number = 0
        self._deadlines = Deadlines()
        self._alarm: asyncio.TimerHandle | None = None
        self._check: asyncio.TimerHandle | None = None
        self._writable = asyncio.Event()
        self._writable.set()
        self._out = Coalescer(self._write)
        self._headers: dict[str, bytes] = {}
        self._ended = False

    @property
    def is_up(self) -> bool:
        """Whether calls can be made."""
        return self._transport is not None and not self._ended

    async def dial(self) -> None:
        """Connect.

        Raises:
            OSError: No address answers.
        """
        problem: Exception = OSError("it has no address")
        for address in self._addresses:
            try:
                async with asyncio.timeout(_DIAL_TIMEOUT_S):
                    await self._connect(address)
                return
            except (OSError, OverflowError, ValueError) as error:
                problem = error
        raise OSError(str(problem) or type(problem).__name__)

    async def _connect(self, address: str) -> None:
        if "://" in address:
            sock = await connected_unix(address)
        else:
            sock = await connected_tcp(*split_address(address))
        try:
            await take_connection(lambda: self, sock)
        except BaseException:
            sock.close()
            raise

    # -- calling -------------------------------------------------------------------------------

    async def call(
        self,
        service: str,
        payload: bytes,
        parse: Callable[[Any], Any],
        timeout_s: float | None,
        priority: int,
    ) -> Any:
        """One call.

        Raises:
            ServiceCallError: It did not succeed.
        """
        number = self._number = self._number + 1
        future: asyncio.Future[Any] = self._loop.create_future()
        self._pending[number] = _Pending(service, future, parse)
        if timeout_s is not None:
            self._deadlines.add(number, self._loop.time() + timeout_s)
            self._arm()
        try:
            if not self._writable.is_set():
                # The timeout ends this wait, too: by the future.
                await self._wait_writable(future)
            if not future.done():
                self._send(service, pack_request(number, timeout_s, priority, payload))
            return await future
        except asyncio.CancelledError:
            if number in self._pending:
                self._take_back(service, number)
            raise
        finally:
            self._pending.pop(number, None)
            self._deadlines.remove(number)

    async def _wait_writable(self, future: asyncio.Future[Any]) -> None:
        waiting = asyncio.ensure_future(self._writable.wait())
        try:
            await asyncio.wait((waiting, future), return_when=asyncio.FIRST_COMPLETED)
        finally:
            waiting.cancel()

    def _send(self, service: str, data: bytes) -> None:
        if self._ended:
            return
        header = self._headers.get(service)
        if header is None:
            header = self._headers[service] = encode_header(service, REQUEST_TYPE)
        self._out.add(header + _pack_u32(len(data)) + data)
        if self._check is None:
            self._check = self._loop.call_later(_CHECK_EVERY_S, self._check_peer)

    def _take_back(self, service: str, number: int) -> None:
        if self.is_up:
            self._out.add(encode_frame(encode_header(service, CANCEL_TYPE), pack_cancel(number)))

    def _write(self, data: bytes) -> None:
        if self._transport is not None:
            self._transport.write(data)

    def _arm(self) -> None:
        due = self._deadlines.next_due
        if due is None or (self._alarm is not None and self._alarm.when() <= due):
            return
        if self._alarm is not None:
            self._alarm.cancel()
        self._alarm = self._loop.call_at(due, self._ring)

    def _ring(self) -> None:
        self._alarm = None
        for number in self._deadlines.overdue(self._loop.time()):
            pending = self._pending.get(number)
            if pending is not None and not pending.future.done():
                pending.future.set_exception(
                    ServiceTimeout(pending.service, f"no answer from node {self.node!r} in time")
                )
                self._take_back(pending.service, number)
        self._arm()

    def _check_peer(self) -> None:
        """End a connection whose host no longer answers, while calls wait."""
        self._check = None
        transport = self._transport
        if transport is None or transport.is_closing() or not self._pending:
            return
        if connection_state(transport.get_extra_info("socket")).is_silent:
            transport.abort()
        else:
            self._check = self._loop.call_later(_CHECK_EVERY_S, self._check_peer)

    # -- the connection ------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin."""
        keep_alive(transport.get_extra_info("socket"))
        # uvloop's transports are none of asyncio's by class.
        self._transport = cast("asyncio.Transport", transport)

    def get_buffer(self, sizehint: int) -> memoryview:  # noqa: ARG002
        """Where the next bytes go."""
        return self._decoder.get_buffer()

    def buffer_updated(self, nbytes: int) -> None:
        """Answers have arrived."""
        lone = self._decoder.lone(nbytes)
        if lone is not None:
            self._answered(lone)
            return
        self.room = None
        for run in self._decoder.received(nbytes):
            for data in run.payloads:
                self._answered(data)
        if self._decoder.expects_lone:
            self.room = self._decoder.get_buffer()
        if self._decoder.error is not None and self._transport is not None:
            logger.warning(
                "node %r does not answer as a simple_ros node: %s", self.node, self._decoder.error
            )
            self._transport.abort()

    def _answered(self, data: Payload) -> None:
        try:
            number, status, payload = unpack_response(data)
        except ValueError as error:
            logger.warning("node %r sent %s", self.node, error)
            return
        pending = self._pending.get(number)
        if pending is None or pending.future.done():
            return
        if status == Status.OK:
            try:
                pending.future.set_result(pending.parse(payload))
            except DecodeError as error:
                pending.future.set_exception(
                    ServiceUnavailable(
                        pending.service,
                        f"node {self.node!r} sent an answer of another type: {error}",
                    )
                )
        else:
            pending.future.set_exception(
                failure_of(pending.service, self.node, status, bytes(payload))
            )

    def pause_writing(self) -> None:
        """The provider does not read: calls wait until it does."""
        self._writable.clear()

    def resume_writing(self) -> None:
        """It reads again."""
        self._writable.set()

    def connection_lost(self, exc: Exception | None) -> None:
        """The provider is gone: nobody waits any longer."""
        self._end(f"node {self.node!r} is gone" + (f" ({exc})" if exc else ""))

    def close(self) -> None:
        """End the connection; calls under way fail."""
        if self._transport is not None:
            self._transport.close()
        self._end("the client was closed")

    def _end(self, reason: str) -> None:
        if self._ended:
            return
        self._ended = True
        self._writable.set()
        for handle in (self._alarm, self._check):
            if handle is not None:
                handle.cancel()
        for pending in list(self._pending.values()):
            if not pending.future.done():
                pending.future.set_exception(ServiceUnavailable(pending.service, reason))
        self._on_lost(self)
