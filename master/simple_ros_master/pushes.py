"""Connections to the nodes: pushes go out on them, and their end tells that a node is gone.

Thin shell around `simple_ros_master.link`. Every address has a task of its own, so a dead or slow
node delays nobody else.
"""

from __future__ import annotations

import asyncio
import errno
import logging
import socket
from collections.abc import Callable, Iterable

from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros_master.link import PushLink, frame_of
from simple_ros_master.peers import Address

__all__ = ["PushPool"]

logger = logging.getLogger(__name__)

CONNECT_TIMEOUT_S = 1.0
_CHUNK = 64 * 1024
_OUR_OWN_TROUBLE = frozenset(
    {errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM, errno.EADDRNOTAVAIL, errno.EACCES}
)
"""Failures to dial that say nothing about the node."""
_KEEPALIVE = {
    "TCP_KEEPIDLE": 2,
    "TCP_KEEPINTVL": 1,
    "TCP_KEEPCNT": 2,
    "TCP_USER_TIMEOUT": 4000,
}
"""Seconds, seconds, probes, milliseconds: a host that vanished is noticed within four seconds."""

Resync = Callable[[Address], Iterable[ros.TopicTargetsUpdate]]
"""Gives everything that the nodes at an address should know."""


class PushPool:
    """One kept connection per node address.

    Args:
        resync: Asked when a connection follows one that broke.
        on_dead: Told when nobody listens at a watched address.
    """

    def __init__(self, resync: Resync, on_dead: Callable[[Address], None]) -> None:
        self._resync = resync
        self._on_dead = on_dead
        self._dialers: dict[Address, _Dialer] = {}
        self._ending: set[asyncio.Task[None]] = set()

    def push(self, address: Address, update: ros.TopicTargetsUpdate) -> None:
        """Send an update, after all that were pushed to the address before."""
        self._dialer(address).push(frame_of(update))

    def watch(self, address: Address, *, on: bool) -> None:
        """Connect and report if nobody listens; without ``on``, report no longer."""
        if on:
            self._dialer(address).watch()
        elif address in self._dialers:
            self._dialers[address].unwatch()

    def close(self, address: Address) -> None:
        """Drop the connection and what was to be sent."""
        dialer = self._dialers.pop(address, None)
        if dialer is not None:
            dialer.task.cancel()
            self._ending.add(dialer.task)
            dialer.task.add_done_callback(self._ending.discard)

    async def stop(self) -> None:
        """Close everything."""
        for address in list(self._dialers):
            self.close(address)
        await asyncio.gather(*self._ending, return_exceptions=True)

    def _dialer(self, address: Address) -> _Dialer:
        dialer = self._dialers.get(address)
        if dialer is None:
            dialer = self._dialers[address] = _Dialer(address, self._resync, self._on_dead)
        return dialer


class _Dialer:
    """Keeps one address connected and feeds it."""

    def __init__(
        self, address: Address, resync: Resync, on_dead: Callable[[Address], None]
    ) -> None:
        self._address = address
        self._resync = resync
        self._on_dead = on_dead
        self._loop = asyncio.get_running_loop()
        self._link = PushLink(self._loop.time())
        self._wake = asyncio.Event()
        self._connection: _Connection | None = None
        self.task = self._loop.create_task(self._run(), name=f"pushes to {address}")

    def push(self, frame: bytes) -> None:
        self._link.push(frame, self._loop.time())
        self._wake.set()
        self._pump()

    def watch(self) -> None:
        self._link.watch(self._loop.time())
        self._wake.set()

    def unwatch(self) -> None:
        self._link.unwatch()

    async def _run(self) -> None:
        while True:
            await self._until_due()
            try:
                self._connection = await _connect(self._address, self._pump)
            except OSError as error:
                logger.debug("%s does not accept: %s", self._address, error)
                refused = error.errno not in _OUR_OWN_TROUBLE
                if self._link.failed(self._loop.time(), refused=refused):
                    self._on_dead(self._address)
            else:
                await self._feed(self._connection)

    async def _feed(self, connection: _Connection) -> None:
        self._link.connected(self._loop.time())
        try:
            self._pump()
            await connection.wait_lost()
        finally:
            self._connection = None
            await connection.abort()
        logger.debug("connection to %s ended", self._address)
        self._link.lost(self._loop.time())

    async def _until_due(self) -> None:
        while (delay := self._link.dial_at - self._loop.time()) > 0:
            self._wake.clear()
            try:
                async with asyncio.timeout(delay):
                    await self._wake.wait()
            except TimeoutError:
                return

    def _pump(self) -> None:
        connection = self._connection
        while connection is not None and connection.writable:
            if self._link.needs_resync:
                self._link.resync([frame_of(update) for update in self._resync(self._address)])
            data = self._link.take(_CHUNK)
            if not data:
                return
            connection.write(data)


class _Connection(asyncio.Protocol):
    """A live connection; nodes never answer on it, so what they say is not heard."""

    def __init__(self, on_writable: Callable[[], None]) -> None:
        self._on_writable = on_writable
        self._transport: asyncio.Transport | None = None
        self._paused = False
        self._lost: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    @property
    def writable(self) -> bool:
        transport = self._transport
        return transport is not None and not self._paused and not transport.is_closing()

    def write(self, data: bytes) -> None:
        if self._transport is not None:
            self._transport.write(data)

    async def wait_lost(self) -> None:
        await asyncio.shield(self._lost)

    async def abort(self) -> None:
        if self._transport is not None:
            self._transport.abort()
            await self._lost

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        if isinstance(transport, asyncio.Transport):
            self._transport = transport

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002
        if not self._lost.done():
            self._lost.set_result(None)

    def pause_writing(self) -> None:
        self._paused = True

    def resume_writing(self) -> None:
        self._paused = False
        self._on_writable()


async def _connect(address: Address, on_writable: Callable[[], None]) -> _Connection:
    """Dial once.

    Raises:
        OSError: Nobody accepted in time, or this host cannot dial now.
    """
    loop = asyncio.get_running_loop()
    sock = socket.socket(socket.AF_INET6 if ":" in address.ip else socket.AF_INET)
    try:
        sock.setblocking(False)
        async with asyncio.timeout(CONNECT_TIMEOUT_S):
            await loop.sock_connect(sock, tuple(address))
        _refuse_oneself(sock)
        _tune(sock)
        _, connection = await loop.create_connection(lambda: _Connection(on_writable), sock=sock)
    except BaseException:
        sock.close()
        raise
    return connection


def _refuse_oneself(sock: socket.socket) -> None:
    # Whoever dials a port of the ephemeral range where nobody listens may be given that very port.
    if sock.getsockname() == sock.getpeername():
        raise ConnectionRefusedError(errno.ECONNREFUSED, "connected to itself")


def _tune(sock: socket.socket) -> None:
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in _KEEPALIVE.items():
        option = getattr(socket, name, None)
        if option is not None:
            sock.setsockopt(socket.IPPROTO_TCP, option, value)
