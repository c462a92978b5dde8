"""The one listener of a node: peers bring data, the Master brings pushes."""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Iterable
from typing import cast

from simple_ros.errors import AddressInUse, FrameError
from simple_ros.net.addresses import join_address, keep_alive, listening_socket
from simple_ros.net.feeder import NO_LANE, Feeder, Lane, LinkReceiver, Source
from simple_ros.net.inbound_stream import take_connection
from simple_ros.net.memory import LARGE_BYTES, keep_large_blocks
from simple_ros.net.shm import SlotReader
from simple_ros.net.transport import SHM, UNIX, Listener, Place, Transport
from simple_ros.wire.framing import DEFAULT_MAX_MESSAGE_BYTES, FrameDecoder, Run

__all__ = ["InboundLink", "NodeServer"]

logger = logging.getLogger(__name__)

_ACCEPT_AGAIN_S = 1.0


class InboundLink(asyncio.BufferedProtocol):
    """One accepted connection. Only clients of services are answered on it.

    Attributes:
        peer: ``host:port`` of the other side, or what its transport calls it.
        violation: Whether it was closed for not speaking simple_ros framing.
        slots: Where large messages are found if the peer shares its memory.
        room: Where the next bytes go, if that is known already.
    """

    def __init__(self, receiver: LinkReceiver, max_message_bytes: int) -> None:
        self.peer = "?"
        self.violation = False
        self.slots: SlotReader | None = None
        self.room: memoryview | None = None
        self._receiver = receiver
        self._max_message_bytes = max_message_bytes
        self._decoder = FrameDecoder(max_message_bytes)
        # Asked for each message: straight to who knows.
        self.get_buffer = self._decoder.get_buffer  # type: ignore[method-assign]
        self._lone = self._decoder.lone
        self._lane: Lane = NO_LANE
        self._transport: asyncio.Transport | None = None
        self._ended = False
        self._answers_wait = False
        self._feeder = Feeder(self, receiver, self._pause, self._go_on)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        # uvloop's transports are none of asyncio's by class.
        self._transport = cast("asyncio.Transport", transport)
        self.peer = _peer_name(transport.get_extra_info("peername"))
        keep_alive(transport.get_extra_info("socket"))

    def get_buffer(self, sizehint: int) -> memoryview:
        return self._decoder.get_buffer(sizehint)

    def buffer_updated(self, nbytes: int) -> None:
        take = self._lane.take_lone
        if take is not None and (payload := self._lone(nbytes)) is not None:
            take(payload)
        else:
            self._take_all(nbytes)

    def _take_all(self, nbytes: int) -> None:
        self.room = None
        if nbytes >= LARGE_BYTES // 4:
            keep_large_blocks()
        if self.slots is None:
            self._feeder.feed(self._decoder.runs(nbytes))
        else:
            self._feed_with_slots(self._decoder.received(nbytes), self.slots)
        if self._decoder.error is not None:
            self._refuse(self._decoder.error)
        elif self._feeder.is_stalled:
            # Some transports bring more all the same; it must not overtake what waits.
            self._lane = NO_LANE
        elif self._decoder.expects_lone:
            # Now, while nothing waits: it takes time when a message has come.
            self._lane = self._receiver.lane_of(self, self._decoder.header)
            self.room = self._decoder.get_buffer()

    def _feed_with_slots(self, runs: list[Run], slots: SlotReader) -> None:
        try:
            found = slots.translate(runs, self._max_message_bytes)
        except FrameError as error:
            self._refuse(error)
            return
        self._feeder.feed(found)
        if not self._feeder.is_stalled:
            slots.handed_on()

    def _refuse(self, error: FrameError) -> None:
        if not self.violation:
            self.violation = True
            self._receiver.link_refused(self.peer, str(error))
            assert self._transport is not None
            self._transport.abort()

    def write(self, data: bytes) -> None:
        """Answer a client. One that does not read its answers is not read any more either."""
        if self._transport is not None and not self._transport.is_closing():
            self._transport.write(data)

    def pause_writing(self) -> None:
        self._answers_wait = True
        self._pause()

    def resume_writing(self) -> None:
        self._answers_wait = False
        if not self._feeder.is_stalled:
            self._go_on()

    def _pause(self) -> None:
        assert self._transport is not None
        self._transport.pause_reading()

    def _go_on(self) -> None:
        if self.slots is not None:
            self.slots.handed_on()
        if self._ended:
            self._receiver.link_ended(self)
        elif self._transport is not None and not (
            self._answers_wait or self._transport.is_closing()
        ):
            self._transport.resume_reading()

    def eof_received(self) -> bool:
        """Close at once: a C++ Master dies if a push connection stays half open."""
        return False

    def connection_lost(self, exc: Exception | None) -> None:
        if self._decoder.mid_message and not self.violation:
            logger.debug("link from %s ended inside a message (%s)", self.peer, exc)
        self._ended = True
        if not self._feeder.is_stalled:
            self._receiver.link_ended(self)

    def expect_life_within(self, seconds: float) -> None:
        """Probe the peer's host so that it is missed after about ``seconds``, in whole seconds."""
        if self._transport is not None and not self._ended and not self._transport.is_closing():
            keep_alive(self._transport.get_extra_info("socket"), idle_s=seconds)

    def close(self) -> None:
        """End the connection."""
        if self._transport is not None:
            self._transport.close()


def _peer_name(name: object) -> str:
    if isinstance(name, tuple) and len(name) >= 2:
        return join_address(str(name[0]), int(name[1]))
    return str(name) if name else "?"


class NodeServer:
    """Listens on one TCP port, on one or more local addresses, and by other transports.

    It accepts by itself: `asyncio.Server`, closed at the moment when a connection arrives, leaves that
    connection open with nobody to close it.
    """

    def __init__(
        self, receiver: LinkReceiver, max_message_bytes: int = DEFAULT_MAX_MESSAGE_BYTES
    ) -> None:
        self.port = 0
        self.links: set[InboundLink] = set()
        self._receiver = receiver
        self.receive = receiver.receive
        self._max_message_bytes = max_message_bytes
        self._sockets: list[socket.socket] = []
        self._accepting: set[asyncio.Task[None]] = set()
        self._listeners: list[Listener] = []
        self._loop = asyncio.get_running_loop()

    async def listen_by(self, transports: Iterable[Transport], place: Place) -> None:
        """Listen by other transports too; one that cannot is left out with a warning."""
        for transport in transports:
            try:
                self._listeners.append(await transport.listen(self._accepted, place))
            except OSError as error:
                level = logging.DEBUG if transport in (SHM, UNIX) else logging.WARNING
                logger.log(level, "not reachable by %s: %s", transport.scheme, error)

    @property
    def further_addresses(self) -> tuple[str, ...]:
        """What peers dial by other transports."""
        return tuple(address for item in self._listeners for address in item.addresses)

    async def start(self, hosts: tuple[str, ...], port: int = 0) -> None:
        """Listen on all ``hosts`` with the same port; 0 takes any free one.

        Raises:
            AddressInUse: Somebody else listens on the port.
        """
        self._sockets = self._bind(hosts, port)
        for sock in self._sockets:
            self._loop.add_reader(sock, self._accept, sock)

    @property
    def hosts(self) -> tuple[str, ...]:
        """The local addresses it listens on."""
        return tuple(sock.getsockname()[0] for sock in self._sockets)

    def _accept(self, sock: socket.socket) -> None:
        try:
            connection, _ = sock.accept()
        except (BlockingIOError, InterruptedError, ConnectionAbortedError):
            return
        except OSError as error:
            # Out of file descriptors, most likely: those who wait stay in the queue.
            logger.warning("cannot accept connections now: %s", error)
            self._loop.remove_reader(sock)
            self._loop.call_later(_ACCEPT_AGAIN_S, self._accept_again, sock)
            return
        connection.setblocking(False)
        task = self._loop.create_task(self._take(connection))
        self._accepting.add(task)
        task.add_done_callback(self._accepting.discard)

    def _accept_again(self, sock: socket.socket) -> None:
        if sock in self._sockets:
            self._loop.add_reader(sock, self._accept, sock)

    async def _take(self, connection: socket.socket) -> None:
        try:
            await take_connection(self._accepted, connection)
        except OSError as error:
            logger.debug("a connection ended before it began: %s", error)
            connection.close()

    def _bind(self, hosts: tuple[str, ...], port: int) -> list[socket.socket]:
        sockets: list[socket.socket] = []
        try:
            for host in hosts:
                sockets.append(listening_socket(host, self.port or port))
                self.port = sockets[0].getsockname()[1]
        except OSError as error:
            if not sockets:
                raise AddressInUse(join_address(hosts[0], port), f" ({error.strerror})") from error
            # The first address works; a second family is a bonus (a host without IPv6, say).
            logger.debug("not listening on %s: %s", hosts[len(sockets)], error)
        return sockets

    def _accepted(self) -> InboundLink:
        link = InboundLink(self, self._max_message_bytes)
        self.links.add(link)
        return link

    def lane_of(self, link: Source, header: bytes) -> Lane:
        """Pass on."""
        return self._receiver.lane_of(link, header)

    def link_refused(self, peer: str, reason: str) -> None:
        """Pass on."""
        self._receiver.link_refused(peer, reason)

    def link_ended(self, link: Source) -> None:
        """Forget the link and pass on."""
        self.links.discard(link)
        self._receiver.link_ended(link)

    async def close(self) -> None:
        """Stop listening and end every connection."""
        for sock in self._sockets:
            self._loop.remove_reader(sock)
            sock.close()
        self._sockets.clear()
        for listener in self._listeners:
            await listener.close()
        self._listeners.clear()
        if self._accepting:
            await asyncio.wait(self._accepting)
        for link in list(self.links):
            link.close()
