"""The transport ``shaped``: links between sites go through the link shaper, links within a site do not.

    SIMPLE_ROS_TRANSPORTS=local,shaped SIMPLE_ROS_SITE=robot SIMPLE_ROS_LINK_SHAPER=127.0.0.1:7310 python camera.py

A publisher that uses it tells the shaper whom it wants to reach, and the shaper dials on. Nothing of that is known
to the Master: the subscriber's address merely says at which site it is.
"""

from __future__ import annotations

import asyncio
import logging
import os
import socket
from collections.abc import Callable
from typing import ClassVar

from simple_ros.errors import ConfigError
from simple_ros.net.addresses import join_address, split_address
from simple_ros.net.stream import StreamTransport, connected_tcp
from simple_ros.net.transport import Acceptor, Listener, Place, Transport
from simple_ros_engines.link_shaper.hello import (
    MAX_LINE_BYTES,
    BadHello,
    Hello,
    hello_line,
    refusal,
)

__all__ = ["OBSERVER", "SITE", "WHERE", "ShapedTransport", "TcpListener", "dial_shaper"]

logger = logging.getLogger(__name__)

SITE = "SIMPLE_ROS_SITE"
WHERE = "SIMPLE_ROS_LINK_SHAPER"
OBSERVER = "observer"
"""A site that is reached directly from everywhere: for tools that look on."""
DEFAULT_SHAPER = "127.0.0.1:7310"
# Small, so that what the link cannot carry waits where it is counted, not in the kernel.
BUFFER_BYTES = 128 * 1024


class TcpListener(Listener):
    """Takes connections on a port of its own.

    Args:
        host: To listen on.
        port: 0 for any.
        accept: Makes a protocol for each connection.
        suffix: Appended to the address that is told.
        told_host: The host that is told; None for ``host``.

    Raises:
        OSError: The port is taken.
    """

    def __init__(
        self,
        host: str,
        port: int,
        accept: Callable[[], asyncio.BaseProtocol],
        suffix: str = "",
        told_host: str | None = None,
    ) -> None:
        self._accept = accept
        self._loop = asyncio.get_running_loop()
        self._accepting: set[asyncio.Task[None]] = set()
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._sock = socket.socket(family, socket.SOCK_STREAM)
        try:
            self._sock.setblocking(False)
            self._sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
            self._sock.bind((host, port))
            self._sock.listen(socket.SOMAXCONN)
        except OSError:
            self._sock.close()
            raise
        self.port: int = self._sock.getsockname()[1]
        self.address = f"shaped://{join_address(told_host or host, self.port)}{suffix}"
        self._loop.add_reader(self._sock, self._come)

    @property
    def addresses(self) -> tuple[str, ...]:
        """What peers dial."""
        return (self.address,)

    def _come(self) -> None:
        try:
            connection, _ = self._sock.accept()
        except (BlockingIOError, InterruptedError, ConnectionAbortedError):
            return
        except OSError as error:
            logger.warning("cannot accept connections now: %s", error)
            return
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        task = self._loop.create_task(self._take(connection))
        self._accepting.add(task)
        task.add_done_callback(self._accepting.discard)

    async def _take(self, connection: socket.socket) -> None:
        try:
            await self._loop.connect_accepted_socket(self._accept, connection)
        except OSError as error:
            logger.debug("a connection ended before it began: %s", error)
            connection.close()

    async def close(self) -> None:
        """Take no more."""
        if self._sock.fileno() != -1:
            self._loop.remove_reader(self._sock)
            self._sock.close()
        if self._accepting:
            await asyncio.wait(self._accepting)


class ShapedTransport(Transport):
    """TCP by way of the link shaper.

    Args:
        site: Where this node is; None takes ``SIMPLE_ROS_SITE``.
        shaper: Address of the shaper; None takes ``SIMPLE_ROS_LINK_SHAPER``, else 127.0.0.1:7310.

    Raises:
        ConfigError: No site is named.
    """

    scheme: ClassVar[str] = "shaped"

    def __init__(self, site: str | None = None, shaper: str | None = None) -> None:
        self.site = site or os.environ.get(SITE, "")
        if not self.site or "/" in self.site:
            raise ConfigError(
                f"the transport 'shaped' must know at which site this node is: set {SITE}, to a link of "
                f"the shaper, to any other name for a wired place, or to {OBSERVER!r} for a tool that looks on"
            )
        self._shaper = split_address(shaper or os.environ.get(WHERE, DEFAULT_SHAPER))
        self._told = False

    async def listen(self, accept: Acceptor, place: Place) -> Listener:
        """Listen on a port of its own; the address says at which site."""
        host = place.ip if place.is_local else "0.0.0.0"
        return TcpListener(host, 0, accept, f"/{self.site}", place.ip)

    async def dial(self, address: str, protocol: asyncio.Protocol) -> None:
        """Connect: through the shaper if the other is at another site."""
        where, _, site = address.partition("://")[2].partition("/")
        if site == self.site or OBSERVER in (site, self.site):
            sock = await connected_tcp(*split_address(where))
        else:
            sock = await self._through_shaper(Hello(self.site, site, where))
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
        protocol.connection_made(StreamTransport(sock, protocol))

    async def _through_shaper(self, hello: Hello) -> socket.socket:
        try:
            sock = await dial_shaper(self._shaper, hello)
        except OSError as error:
            if not self._told:
                self._told = True
                shaper = join_address(*self._shaper)
                logger.warning(
                    "no link to site %r by the shaper at %s: %s", hello.target, shaper, error
                )
            raise
        self._told = False
        return sock


async def dial_shaper(shaper: tuple[str, int], hello: Hello) -> socket.socket:
    """A connection to the shaper on which everything is said that needs to be said.

    Raises:
        OSError: The shaper does not answer, or refuses.
    """
    sock = await connected_tcp(*shaper)
    try:
        await asyncio.get_running_loop().sock_sendall(sock, hello_line(hello))
        _check(await _answer(sock))
    except BaseException:
        sock.close()
        raise
    return sock


async def _answer(sock: socket.socket) -> bytes:
    loop = asyncio.get_running_loop()
    line = b""
    while not line.endswith(b"\n"):
        # Byte by byte: what follows the line is none of ours.
        byte = await loop.sock_recv(sock, 1)
        if not byte or len(line) > MAX_LINE_BYTES:
            raise ConnectionResetError("the shaper gave no answer")
        line += byte
    return line


def _check(line: bytes) -> None:
    try:
        reason = refusal(line)
    except BadHello as error:
        raise ConnectionRefusedError(f"no link shaper listens there: {error}") from None
    if reason:
        raise ConnectionRefusedError(f"the shaper says: {reason}")
