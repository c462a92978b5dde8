"""A publisher's connection to the link shaper, and the one that goes on to its subscriber."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections import deque
from collections.abc import Iterable
from struct import Struct
from typing import Any, Protocol, cast

from simple_ros.errors import ConfigError
from simple_ros.net.addresses import split_address
from simple_ros.net.stream import StreamTransport, connected_tcp
from simple_ros.wire.framing import FrameDecoder, Run, header_names
from simple_ros_engines.link_shaper.hello import (
    MAX_LINE_BYTES,
    BadHello,
    Hello,
    answer_line,
    parse_hello,
)
from simple_ros_engines.simulator.shaper import LinkShaper, ShapedConnection

__all__ = ["Incoming", "Owner"]

logger = logging.getLogger(__name__)

_SIZE = Struct(">I")
_DIAL_S = 5.0
_MOST_UNREAD_BYTES = 1 << 20


class Owner(Protocol):
    """What a connection needs of the relay."""

    machine: LinkShaper
    incoming: set[Incoming]

    def catch_up(self) -> float:
        """Hand on what has arrived; tells the time."""

    def pump(self) -> float:
        """Hand on, let in, look when to do so again; tells the time."""

    def hold(self, incoming: Incoming) -> None:
        """There is no room for a connection's message."""

    def forget(self, incoming: Incoming) -> None:
        """A publisher is gone."""

    def watch(self, incoming: Incoming) -> None:
        """A connection wants records."""


class Incoming(asyncio.BufferedProtocol):
    """A publisher's connection, and the one that goes on to its subscriber.

    Args:
        relay: Whose it is.

    Attributes:
        arrived: Frames to hand on.
        ports: The publisher's port and the shaper's.
    """

    def __init__(self, relay: Owner) -> None:
        self.arrived: list[bytes] = []
        self.ports = (0, 0)
        self._relay = relay
        self._decoder = FrameDecoder()
        self._first = bytearray()
        self._chunk = bytearray(MAX_LINE_BYTES)
        self._hello: Hello | None = None
        self._pending: deque[tuple[ShapedConnection, bytes]] = deque()
        self._connections: dict[bytes, ShapedConnection] = {}
        self._outgoing: StreamTransport | None = None
        self._dialling: asyncio.Task[None] | None = None
        self._is_blocked = False
        self._ended = False
        self._dscp = 0

    @property
    def pending_count(self) -> int:
        """Messages that wait at the door."""
        return len(self._pending)

    # -- the publisher's side ----------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """A node dialled."""
        self._transport = cast("asyncio.Transport", transport)
        peer = transport.get_extra_info("peername")
        own = transport.get_extra_info("sockname")
        self.ports = (peer[1], own[1]) if peer and own else (0, 0)
        self._relay.incoming.add(self)

    def get_buffer(self, sizehint: int) -> Any:  # noqa: ARG002
        """Where the next bytes go."""
        return self._chunk if self._hello is None else self._decoder.get_buffer()

    def buffer_updated(self, nbytes: int) -> None:
        """Bytes came."""
        if self._hello is not None:
            self._take(self._decoder.received(nbytes))
            return
        self._first += self._chunk[:nbytes]
        line, newline, rest = bytes(self._first).partition(b"\n")
        if newline:
            self._greeted(line)
            if rest:
                self._take(self._decoder.feed(rest))
        elif len(self._first) > MAX_LINE_BYTES:
            self._refuse("the first line is too long")

    def _greeted(self, line: bytes) -> None:
        try:
            hello = parse_hello(line)
        except BadHello as error:
            self._refuse(str(error))
            return
        self._hello = hello
        if hello.watches:
            self.tell(answer_line())
            self._relay.watch(self)
        else:
            self._transport.pause_reading()
            self._dialling = asyncio.create_task(self._dial(hello))

    def _refuse(self, reason: str) -> None:
        logger.warning("a connection from port %d is refused: %s", self.ports[0], reason)
        self._transport.write(answer_line(reason))
        self._transport.close()

    async def _dial(self, hello: Hello) -> None:
        try:
            host, port = split_address(hello.address)
            async with asyncio.timeout(_DIAL_S):
                sock = await connected_tcp(host, port)
        except (OSError, ConfigError) as error:
            reason = f"{hello.address} at {hello.target} does not answer: {error}"
            self._transport.write(answer_line(reason))
            self._transport.close()
            return
        self._outgoing = StreamTransport(sock, _Outgoing(self))
        if self._ended:
            self._outgoing.abort()
            return
        self._transport.write(answer_line())
        self._transport.resume_reading()

    def _take(self, runs: Iterable[Run]) -> None:
        now_s = self._relay.catch_up()
        for run in runs:
            connection = self._connection(run.header)
            if run.oversized:
                logger.warning(
                    "%s: a message of %d bytes is too large", connection.topic, run.oversized
                )
            for payload in run.payloads:
                frame = b"".join((run.header, _SIZE.pack(len(payload)), payload))
                self._pending.append((connection, frame))
        if self._decoder.error is not None:
            logger.warning("a publisher is cut off: %s", self._decoder.error)
            self._transport.abort()
            return
        if not self.offer_pending(now_s):
            self._relay.hold(self)
        self._relay.pump()

    def _connection(self, header: bytes) -> ShapedConnection:
        found = self._connections.get(header)
        if found is None:
            assert self._hello is not None
            hello, names = self._hello, header_names(header)
            topic = names[0] if names is not None else ""
            found = self._relay.machine.open(hello.source, hello.target, topic, self, self._dscp)
            self._connections[header] = found
        return found

    def offer_pending(self, now_s: float) -> bool:
        """Let in what waits at the door; False if there is no room for all of it."""
        while self._pending:
            connection, frame = self._pending[0]
            if not connection.hops:
                self.arrived.append(frame)
                self.hand_on()
            elif not self._relay.machine.offer(connection, frame, len(frame), now_s):
                break
            self._pending.popleft()
        self._read_on()
        return not self._pending

    def _read_on(self) -> None:
        if self._ended or self._transport.is_closing():
            return
        if self._pending or self._is_blocked:
            self._transport.pause_reading()
        else:
            self._transport.resume_reading()

    def code_point_is(self, dscp: int) -> None:
        """The publisher's connection has this code point now."""
        if dscp != self._dscp:
            self._dscp = dscp
            for connection in self._connections.values():
                self._relay.machine.reclass(connection, dscp)

    def eof_received(self) -> bool:
        """Nothing more comes."""
        return False

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002
        """The publisher is gone; what is on its way still arrives."""
        self._ended = True
        if self._outgoing is None and self._dialling is not None:
            self._dialling.cancel()
        self._relay.forget(self)

    # -- the subscriber's side ---------------------------------------------------------------------

    def hand_on(self) -> None:
        """Write what has arrived."""
        frames, self.arrived = self.arrived, []
        if self._outgoing is not None and frames:
            self._outgoing.writelines(frames)

    def end_if_done(self) -> bool:
        """End the way on if the publisher is gone and nothing is on its way; tells whether that is so."""
        if self._pending or not all(item.is_idle for item in self._connections.values()):
            return False
        if self._outgoing is not None:
            self._outgoing.close()
        return True

    def blocked(self, is_blocked: bool) -> None:
        """The subscriber does not keep up, or does again."""
        self._is_blocked = is_blocked
        self._read_on()

    def subscriber_left(self) -> None:
        """The way on is gone."""
        self._pending.clear()
        self._outgoing = None
        if not self._ended:
            self._transport.abort()

    # -- those who watch ---------------------------------------------------------------------------

    def tell(self, lines: bytes) -> None:
        """Write to who dialled; who does not read is cut off."""
        if self._transport.get_write_buffer_size() > _MOST_UNREAD_BYTES:
            self._transport.abort()
        else:
            self._transport.write(lines)

    async def abandon(self) -> None:
        """End at once."""
        if self._dialling is not None:
            self._dialling.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._dialling
        if self._outgoing is not None:
            self._outgoing.abort()
        self._transport.abort()


class _Outgoing(asyncio.Protocol):
    def __init__(self, incoming: Incoming) -> None:
        self._incoming = incoming

    def pause_writing(self) -> None:
        self._incoming.blocked(True)

    def resume_writing(self) -> None:
        self._incoming.blocked(False)

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002
        self._incoming.subscriber_left()
