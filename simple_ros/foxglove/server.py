"""The server: channels and services on one side, clients on the other.

It knows nothing of nodes. What clients want is handed to ``on_event``; what there is to see is put in by
`FoxgloveServer.publish`. `bridge` and `playback` build on it.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import ssl
import time
from collections.abc import AsyncIterator, Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from websockets.http11 import Request

from simple_ros.foxglove import frames
from simple_ros.foxglove.access import Access, Refusal
from simple_ros.foxglove.catalog import Catalog
from simple_ros.foxglove.client import Client, ClientStatistics
from simple_ros.foxglove.connection import Connection
from simple_ros.foxglove.convert import DEFAULT_FRAME
from simple_ros.foxglove.errors import CannotListen
from simple_ros.foxglove.events import ChannelUnwanted, ChannelWanted, Event
from simple_ros.foxglove.frames import Channel, Level, Schema, Service
from simple_ros.foxglove.rates import RateLimit, TopicLimits
from simple_ros.foxglove.session import Session

__all__ = [
    "DEFAULT_BUFFER_BYTES",
    "DEFAULT_PORT",
    "FoxgloveServer",
    "ServerOptions",
    "Tap",
    "tls_context",
]

logger = logging.getLogger(__name__)

DEFAULT_PORT = 8765
DEFAULT_BUFFER_BYTES = 16 * 1024 * 1024
_TICK_S = 0.1
_GOODBYE_S = 1.0
_MOST_LOGGED = 100


class Tap(Protocol):
    """Sees every message that some client is subscribed to."""

    def saw(
        self, channel: Channel, stamp_ns: int, payloads: Sequence[bytes], *, latched: bool
    ) -> None:
        """Messages of one channel, which may be latched, came at one time."""


@dataclass(frozen=True)
class ServerOptions:
    """How to serve.

    Attributes:
        name: Shown by apps.
        access: Who may connect and what is shown.
        buffer_bytes: How much may wait for each client.
        rates: How often messages of a topic are sent, in Hz.
        depths: How many messages of a topic wait for a client, the newest.
        metadata: Told to clients.
        frame_id: The frame of messages that name none, where panels need one.
        compress: Whether to compress what is sent, for slow links: it costs much computing.
    """

    name: str = "simple_ros"
    access: Access = field(default_factory=Access)
    buffer_bytes: int = DEFAULT_BUFFER_BYTES
    rates: TopicLimits = field(default_factory=TopicLimits)
    depths: TopicLimits = field(default_factory=TopicLimits)
    metadata: Mapping[str, str] = field(default_factory=dict)
    frame_id: str = DEFAULT_FRAME
    compress: bool = False


def tls_context(certificate: Path, key: Path | None = None) -> ssl.SSLContext:
    """What ``wss://`` needs, from PEM files.

    Args:
        certificate: The certificate with its chain.
        key: Its private key, if it is in another file.

    Raises:
        CannotListen: The files are not there or do not fit together.
    """

    def asked() -> str:
        # Otherwise OpenSSL asks at the terminal, and a service hangs.
        raise CannotListen(f"TLS key {key or certificate}: it is encrypted; give one that is not")

    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        context.load_cert_chain(certificate, key, asked)
    except CannotListen:
        raise
    except OSError as error:  # ssl.SSLError is one
        reason = error.strerror or str(error)
        raise CannotListen(f"TLS certificate {certificate}: {reason}") from None
    return context


class FoxgloveServer:
    """Serves any number of clients. Use it as ``async with server.listening(...)``.

    Args:
        options: How.
        capabilities: Some of `frames.CAPABILITIES`: what ``on_event`` knows to handle.
        clock_ns: The time, in ns since 1970; 0 for none yet.
        span_ns: Beginning and end of what is played, if it is a recording.

    Attributes:
        catalog: What is offered; changed by the methods here.
        on_event: Called with each client and what it does; to be set before it listens.
        on_client: Called with each client that comes.
        on_gone: Called with each client that has gone.
        port: Where it listens.
    """

    def __init__(
        self,
        options: ServerOptions,
        capabilities: Iterable[str],
        clock_ns: Callable[[], int] = time.time_ns,
        span_ns: tuple[int, int] | None = None,
    ) -> None:
        self.options = options
        self.catalog = Catalog()
        self.on_event: Callable[[Client, Event], None] = lambda _client, _event: None
        self.on_client: Callable[[Client], None] = lambda _: None
        self.on_gone: Callable[[Client], None] = lambda _: None
        self.port = 0
        self._capabilities = frozenset(capabilities)
        self._clock_ns = clock_ns
        self._span_ns = span_ns
        self._session = str(time.time_ns() // 10**6)
        self._clients: dict[Client, None] = {}
        self._wanting: dict[int, dict[Client, None]] = {}
        self._limits: dict[int, RateLimit] = {}
        self._latched: set[int] = set()
        self._statuses: dict[str, str] = {}
        self._tap: Tap | None = None
        self._gone_dropped = 0
        self._someone_left = asyncio.Event()
        self._refusals: set[Refusal] = set()

    # -- life ----------------------------------------------------------------------------------

    @contextlib.asynccontextmanager
    async def listening(
        self,
        host: str = "127.0.0.1",
        port: int = DEFAULT_PORT,
        tls: ssl.SSLContext | None = None,
    ) -> AsyncIterator[FoxgloveServer]:
        """Accept clients meanwhile.

        Args:
            host: Address to listen on.
            port: 0 takes any free one; see `port`.
            tls: For ``wss://``.

        Raises:
            CannotListen: The address cannot be used.
        """
        loop = asyncio.get_running_loop()

        def made() -> Connection:
            return Connection(
                self._refusal,
                self._accepted,
                loop,
                compress=self.options.compress,
            )

        try:
            listener = await loop.create_server(made, host, port, ssl=tls)
        except OSError as error:
            reason = error.strerror or str(error)
            raise CannotListen(f"cannot listen on {host}:{port}: {reason}") from None
        self.port = listener.sockets[0].getsockname()[1]
        ticking = loop.create_task(self._tick(), name="foxglove ticks")
        try:
            yield self
        finally:
            ticking.cancel()
            listener.close()
            for client in list(self._clients):
                client.close(1001, "the server ends")
            await self._until_gone()
            await asyncio.gather(ticking, return_exceptions=True)

    async def _until_gone(self) -> None:
        try:
            async with asyncio.timeout(_GOODBYE_S):
                while self._clients:
                    self._someone_left.clear()
                    await self._someone_left.wait()
        except TimeoutError:
            for client in list(self._clients):
                client.cut()
            # Cutting takes effect with the next turn of the loop.
            await asyncio.sleep(0)

    async def _tick(self) -> None:
        while True:
            await asyncio.sleep(_TICK_S)
            for client in list(self._clients):
                client.tick()

    # -- clients -------------------------------------------------------------------------------

    def _refusal(self, request: Request) -> Refusal | None:
        refusal = self.options.access.refusal(request.path, request.headers)
        # Apps try again every few seconds: each reason is logged once.
        if refusal is not None and refusal not in self._refusals:
            if len(self._refusals) < _MOST_LOGGED:
                self._refusals.add(refusal)
            logger.warning("a client is refused: %s (logged once)", refusal.reason)
        return refusal

    def _accepted(self, connection: Connection) -> Client:
        session = Session(
            self.catalog,
            self._capabilities,
            with_metadata=connection.subprotocol == frames.SUBPROTOCOLS[0],
        )
        clock = self._clock_ns if "time" in self._capabilities else None
        client = Client(
            connection, session, self.options.buffer_bytes, clock, self._event, self._lost
        )
        self._clients[client] = None
        logger.info("client %s came (%s)", connection.peer, connection.subprotocol)
        client.begin(self._server_info(with_span=connection.subprotocol == frames.SUBPROTOCOLS[0]))
        for status in self._statuses.values():
            session.say(status)
        client.process()
        self.on_client(client)
        return client

    def _server_info(self, *, with_span: bool) -> str:
        return frames.server_info(
            self.options.name,
            self._session,
            self._capabilities,
            self.options.metadata,
            self._span_ns if with_span else None,
        )

    def _lost(self, client: Client) -> None:
        self._clients.pop(client, None)
        self._gone_dropped += client.statistics.dropped_total
        self._someone_left.set()
        self.on_gone(client)
        logger.info("client %s has gone", client.statistics.peer)

    def _event(self, client: Client, event: Event) -> None:
        match event:
            case ChannelWanted(channel, subscription):
                topic = self.catalog.channels[channel].topic
                depth = self.options.depths.of(topic)
                limit = None if depth is None else int(depth)
                client.open(channel, subscription, limit, spared=channel in self._latched)
                self._wanting.setdefault(channel, {})[client] = None
            case ChannelUnwanted(channel):
                client.stop(channel)
                wanting = self._wanting.get(channel, {})
                wanting.pop(client, None)
                if not wanting:
                    self._wanting.pop(channel, None)
        self.on_event(client, event)

    @property
    def clients(self) -> tuple[Client, ...]:
        """Those that are connected."""
        return tuple(self._clients)

    @property
    def statistics(self) -> tuple[ClientStatistics, ...]:
        """Counters of all clients that are connected."""
        return tuple(client.statistics for client in self._clients)

    @property
    def dropped(self) -> int:
        """Messages that fell, for all clients there were."""
        return self._gone_dropped + sum(item.dropped_total for item in self.statistics)

    # -- what is offered -----------------------------------------------------------------------

    def add_channel(
        self,
        topic: str,
        schema_name: str,
        schema: str,
        *,
        encoding: str = "protobuf",
        schema_encoding: str = "protobuf",
        metadata: Mapping[str, str] | None = None,
        recorded_as: tuple[str, bytes] | None = None,
    ) -> Channel:
        """Offer a channel; for the arguments see `Channel`."""
        channel = self.catalog.add_channel(
            topic,
            schema_name,
            schema,
            encoding=encoding,
            schema_encoding=schema_encoding,
            metadata=metadata,
            recorded_as=recorded_as,
        )
        rate = self.options.rates.of(topic)
        if rate is not None:
            self._limits[channel.id] = RateLimit(rate)
        self._tell_all(lambda session: session.offer_channels([channel]))
        return channel

    def remove_channels(self, ids: Iterable[int]) -> None:
        """Offer channels no more."""
        gone = self.catalog.remove_channels(ids)
        self._tell_all(lambda session: session.withdraw_channels(gone))
        for channel in gone:
            self._limits.pop(channel, None)
            self._latched.discard(channel)

    def add_service(self, name: str, type_name: str, request: Schema, response: Schema) -> Service:
        """Offer a service."""
        service = self.catalog.add_service(name, type_name, request, response)
        self._tell_all(lambda session: session.offer_services([service]))
        return service

    def remove_services(self, ids: Iterable[int]) -> None:
        """Offer services no more."""
        gone = self.catalog.remove_services(ids)
        self._tell_all(lambda session: session.withdraw_services(gone))

    def _tell_all(self, tell: Callable[[Session], None]) -> None:
        for client in list(self._clients):
            tell(client.session)
            client.process()

    # -- what is said --------------------------------------------------------------------------

    def say_status(self, level: Level, message: str, id: str) -> None:  # noqa: A002
        """Tell all clients something, those that come later too, until it is taken back."""
        frame = frames.status(level, message, id)
        if self._statuses.get(id) != frame:
            self._statuses[id] = frame
            self._tell_all(lambda session: session.say(frame))

    def take_back_status(self, id: str) -> None:  # noqa: A002
        """What was told under an id no longer holds."""
        if self._statuses.pop(id, None) is not None:
            frame = frames.remove_status(id)
            self._tell_all(lambda session: session.say(frame))

    def say_if(self, wanted: Callable[[Session], bool], frame: str | bytes) -> None:
        """Send a frame to the clients that want it."""
        for client in list(self._clients):
            if wanted(client.session):
                client.session.say(frame)
                client.process()

    def reset_session(self) -> None:
        """Time went back: let all clients forget what they showed."""
        self._session = str(max(int(self._session) + 1, time.time_ns() // 10**6))
        for client in list(self._clients):
            is_sdk = client.statistics.subprotocol == frames.SUBPROTOCOLS[0]
            client.reset_time(self._server_info(with_span=is_sdk))

    def time_jumped(self) -> None:
        """Playback goes on elsewhere: send no more of what waits."""
        for client in self._clients:
            client.jump()

    # -- messages ------------------------------------------------------------------------------

    def is_wanted(self, channel: int) -> bool:
        """Whether any client is subscribed to a channel."""
        return channel in self._wanting

    def tap(self, tap: Tap | None) -> None:
        """Let somebody see what clients see."""
        self._tap = tap

    def has_topic(self, topic: str) -> bool:
        """Whether a channel of that topic is offered."""
        return any(channel.topic == topic for channel in self.catalog.channels.values())

    def mark_latched(self, channel: int) -> None:
        """Messages of a channel count for long: they fall last."""
        self._latched.add(channel)
        for client in self._wanting.get(channel, ()):
            client.queue.spare(channel)

    def publish(self, channel: int, stamp_ns: int, payloads: Sequence[bytes]) -> None:
        """Send messages to the clients that are subscribed to a channel.

        Args:
            channel: Its id.
            stamp_ns: When they came, in ns since 1970.
            payloads: In the channel's encoding.
        """
        wanting = self._wanting.get(channel)
        if wanting is None:
            return
        limit = self._limits.get(channel)
        if limit is not None and channel not in self._latched:
            now = time.monotonic()
            payloads = [payload for payload in payloads if limit.passes(now)]
        for payload in payloads:
            message = frames.message_parts(stamp_ns, payload)
            size = len(payload)
            for client in wanting:
                client.put(channel, message, size)
        if self._tap is not None and payloads:
            latched = channel in self._latched
            self._tap.saw(self.catalog.channels[channel], stamp_ns, payloads, latched=latched)

    def publish_to(self, client: Client, channel: int, stamp_ns: int, payload: bytes) -> None:
        """Send a message to one client that is subscribed to a channel."""
        if client in self._wanting.get(channel, ()):
            client.put(channel, frames.message_parts(stamp_ns, payload), len(payload))
