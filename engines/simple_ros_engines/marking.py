"""Marking the packets of a publisher: DSCP and socket priority, on live connections and on those to come.

    ways, marks = marked(node.transports)
    publisher = await node.advertise("cmd_vel", Twist, transports=ways)
    marks.set(dscp=46, priority=6)

One connection belongs to one topic and subscriber, so every topic can be marked on its own. Networks, the operating
system's queues and the link shaper may then tell urgent from bulk.
"""

from __future__ import annotations

import asyncio
import socket
import weakref
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from simple_ros.errors import ConfigError
from simple_ros.net.transport import Acceptor, InProcess, Listener, Place, Transport

__all__ = ["Marking", "Marks", "marked"]

_INTERNET = (socket.AF_INET, socket.AF_INET6)


@dataclass(frozen=True, slots=True)
class Marking:
    """What the kernel says of the connections now.

    Attributes:
        connections: How many there are.
        marked: How many of them have what was asked for, read back from the kernel.
        problems: Why others have not; one text for each cause.
    """

    connections: int
    marked: int
    problems: tuple[str, ...] = ()


class Marks:
    """The marks of one publisher's connections.

    Attributes:
        dscp: Code point, 0..63; None leaves it alone.
        priority: Of the socket (SO_PRIORITY), 0..6 without further rights; None leaves it alone.
    """

    def __init__(self) -> None:
        self.dscp: int | None = None
        self.priority: int | None = None
        self._sockets: weakref.WeakSet[Any] = weakref.WeakSet()

    def set(self, *, dscp: int | None = None, priority: int | None = None) -> Marking:
        """Mark all connections, now and later; what the kernel says of them now.

        Raises:
            ConfigError: A number is out of its range.
        """
        if dscp is not None and not 0 <= dscp <= 63:
            raise ConfigError(f"a code point (DSCP) is 0 to 63, not {dscp}")
        if priority is not None and not 0 <= priority <= 15:
            raise ConfigError(f"a socket priority is 0 to 15, not {priority}")
        self.dscp, self.priority = dscp, priority
        problems = [problem for sock in self._open() if (problem := self._mark(sock))]
        return self._marking(tuple(dict.fromkeys(problems)))

    def check(self) -> Marking:
        """What the kernel says of the connections now."""
        return self._marking(())

    def _marking(self, problems: tuple[str, ...]) -> Marking:
        found = self._open()
        return Marking(len(found), sum(self._holds(sock) for sock in found), problems)

    def _open(self) -> list[socket.socket]:
        return [sock for sock in self._sockets if sock.fileno() != -1]

    def came(self, sock: socket.socket | None) -> None:
        """A connection stands."""
        if sock is not None:
            self._sockets.add(sock)
            self._mark(sock)

    def _mark(self, sock: socket.socket) -> str:
        """Set the options; why that failed, or nothing."""
        try:
            if self.dscp is not None and sock.family in _INTERNET:
                level, name = _service_option(sock)
                sock.setsockopt(level, name, self.dscp << 2)
            # Last: setting a type of service sets a priority too.
            if self.priority is not None:
                sock.setsockopt(socket.SOL_SOCKET, socket.SO_PRIORITY, self.priority)
        except OSError as error:
            return f"DSCP {self.dscp}, priority {self.priority}: {error.strerror}"
        return ""

    def _holds(self, sock: socket.socket) -> bool:
        try:
            if self.dscp is not None and sock.family in _INTERNET:
                level, name = _service_option(sock)
                if sock.getsockopt(level, name) >> 2 != self.dscp:
                    return False
            wanted = self.priority
            return (
                wanted is None or sock.getsockopt(socket.SOL_SOCKET, socket.SO_PRIORITY) == wanted
            )
        except OSError:
            # It was closed meanwhile.
            return False


def _service_option(sock: socket.socket) -> tuple[int, int]:
    if sock.family == socket.AF_INET6:
        return socket.IPPROTO_IPV6, socket.IPV6_TCLASS
    return socket.IPPROTO_IP, socket.IP_TOS


def marked(
    transports: Sequence[Transport | InProcess],
) -> tuple[tuple[str | Transport, ...], Marks]:
    """The same transports for one publisher, and the marks of all connections they will make."""
    marks = Marks()
    ways = tuple(
        _MarkedTransport(way, marks) if isinstance(way, Transport) else way.value
        for way in transports
    )
    return ways, marks


class _MarkedTransport(Transport):
    """Another transport, whose connections are marked."""

    def __init__(self, inner: Transport, marks: Marks) -> None:
        self.scheme = inner.scheme  # type: ignore[misc]
        self.is_reliable = inner.is_reliable
        self.max_write_bytes = inner.max_write_bytes
        self._inner = inner
        self._marks = marks

    async def listen(self, accept: Acceptor, place: Place) -> Listener:
        return await self._inner.listen(accept, place)

    async def dial(self, address: str, protocol: asyncio.Protocol) -> None:
        await self._inner.dial(address, _Marker(protocol, self._marks))


class _Marker(asyncio.Protocol):
    """A protocol that shows its socket before it begins."""

    def __init__(self, inner: asyncio.Protocol, marks: Marks) -> None:
        self._inner = inner
        self._marks = marks
        self.pause_writing = inner.pause_writing  # type: ignore[method-assign]
        self.resume_writing = inner.resume_writing  # type: ignore[method-assign]
        self.data_received = inner.data_received  # type: ignore[method-assign]
        self.connection_lost = inner.connection_lost  # type: ignore[method-assign]

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        sock = transport.get_extra_info("socket")
        self._marks.came(sock if hasattr(sock, "setsockopt") else None)
        self._inner.connection_made(transport)
