"""Transports: how frames get from a publisher's process to a subscriber's.

A publisher dials each subscriber; one connection per topic and subscriber. A transport makes these
connections, as asyncio transports: it attaches the `asyncio.Protocol` it is given to something that
carries bytes. TCP is one, and always there, since Masters push over it. Which others a node uses, in
the order of preference, is said by name (``NodeHandle(transports=("udp", "tcp"))``, or the environment
variable ``SIMPLE_ROS_TRANSPORTS``); the names are entry points in the group ``simple_ros.transports``.

A node tells its addresses of other transports to the Master as ``scheme://...``; peers that do not know
the scheme ignore them.
"""

from __future__ import annotations

import asyncio
import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import ClassVar, TypeAlias

from simple_ros import plugins
from simple_ros.errors import ConfigError
from simple_ros.net import shm
from simple_ros.net.addresses import join_address, split_address
from simple_ros.net.stream import StreamTransport, connected_tcp
from simple_ros.net.unix import UnixListener, dial_unix, is_available
from simple_ros.wire.session import Target

__all__ = [
    "Acceptor",
    "InProcess",
    "Listener",
    "Place",
    "TcpTransport",
    "Transport",
    "TransportChoice",
    "Way",
    "chosen_transports",
    "feed",
    "scheme_of",
    "ways_to",
]


class InProcess(Enum):
    """How nodes of one event loop are joined directly, with no transport.

    By ``COPY`` each subscriber's node gets an object of its own. By ``REFERENCE`` nothing is serialised:
    publisher and subscribers share one object, which nobody may change once it is published.
    """

    COPY = "local"
    REFERENCE = "reference"


DEFAULT_TRANSPORTS = (InProcess.COPY.value, "shm", "unix", "tcp")
Acceptor: TypeAlias = "Callable[[], asyncio.BufferedProtocol]"
TransportChoice: TypeAlias = "Sequence[str | Transport] | None"


@dataclass(frozen=True, slots=True)
class Place:
    """Who listens, and where.

    Attributes:
        node: Node name.
        instance_id: Which start of the node; unique.
        ip: The IPv4 address under which peers know this host.
        is_local: Whether only this host's processes are to reach it.
    """

    node: str
    instance_id: str
    ip: str
    is_local: bool


class Listener(ABC):
    """The incoming side of a transport in one node."""

    @property
    @abstractmethod
    def addresses(self) -> tuple[str, ...]:
        """What peers dial, each ``scheme://...``."""

    @abstractmethod
    async def close(self) -> None:
        """Accept nothing more. Connections that stand are closed by the node."""


class Transport(ABC):
    """The contract. One object serves all links of a node.

    Attributes:
        scheme: Its name, and what its addresses begin with.
        is_reliable: Whether everything written arrives, in order, or the connection is lost. One that
            is not only carries topics whose publisher offers best effort.
        max_write_bytes: The most it takes in one write, None for no limit. Larger messages are
            dropped and counted.

    The asyncio transports it makes promise more than asyncio asks: each write consists of whole frames
    and arrives whole or not at all. `feed` hands bytes to the receiving protocol. Nothing is ever
    written from the receiving side.
    """

    scheme: ClassVar[str]
    is_reliable: bool = True
    max_write_bytes: int | None = None

    @abstractmethod
    async def listen(self, accept: Acceptor, place: Place) -> Listener:
        """Take connections: for each, attach a protocol that ``accept`` makes.

        Raises:
            OSError: It cannot listen here; the node goes on without this transport.
        """

    @abstractmethod
    async def dial(self, address: str, protocol: asyncio.Protocol) -> None:
        """Connect to an address of another node's `Listener` and attach the protocol.

        Cancelled after 5 s; called again with growing delays until it succeeds.

        Raises:
            OSError: Nobody answers.
            ValueError: The address makes no sense.
        """


class TcpTransport(Transport):
    """Plain TCP to ``host:port``. Listening is the node's own `NodeServer`, always there."""

    scheme = "tcp"

    async def listen(self, accept: Acceptor, place: Place) -> Listener:  # noqa: ARG002
        """Not used: a node listens on TCP in any case."""
        raise OSError("a node listens on TCP already")

    async def dial(self, address: str, protocol: asyncio.Protocol) -> None:
        """Connect."""
        sock = await connected_tcp(*split_address(address))
        protocol.connection_made(StreamTransport(sock, protocol))


class UnixTransport(Transport):
    """Unix sockets, for peers on this host; others take the next way."""

    scheme = "unix"

    async def listen(self, accept: Acceptor, place: Place) -> Listener:
        """Listen under the node's instance id."""
        if not is_available():
            raise OSError("this system has no abstract Unix sockets")
        return _UnixListener(UnixListener(place.instance_id, accept))

    async def dial(self, address: str, protocol: asyncio.Protocol) -> None:
        """Connect."""
        await dial_unix(address, protocol)


class ShmTransport(Transport):
    """Unix sockets, with large messages in shared memory; see `simple_ros.net.shm`."""

    scheme = "shm"

    async def listen(self, accept: Acceptor, place: Place) -> Listener:
        """Listen under the node's instance id."""
        if not shm.is_available():
            raise OSError("this system shares no memory")
        return _UnixListener(shm.ShmListener(place.instance_id, accept))

    async def dial(self, address: str, protocol: asyncio.Protocol) -> None:
        """Connect."""
        await shm.dial_shm(address, protocol)


class _UnixListener(Listener):
    def __init__(self, inner: UnixListener) -> None:
        self.inner = inner

    @property
    def addresses(self) -> tuple[str, ...]:
        return self.inner.addresses

    async def close(self) -> None:
        await self.inner.close()


TCP = TcpTransport()
UNIX = UnixTransport()
SHM = ShmTransport()
_BUILT_IN: dict[str, Transport] = {item.scheme: item for item in (TCP, UNIX, SHM)}


def feed(protocol: asyncio.BufferedProtocol, data: bytes | memoryview) -> None:
    """Give received bytes to a protocol that reads into its own buffer."""
    rest = memoryview(data)
    while rest:
        buffer = memoryview(protocol.get_buffer(len(rest))).cast("B")
        count = min(len(buffer), len(rest))
        buffer[:count] = rest[:count]
        protocol.buffer_updated(count)
        rest = rest[count:]


def chosen_transports(choice: TransportChoice = None) -> tuple[Transport | InProcess, ...]:
    """The transports to use, most wanted first.

    Args:
        choice: Names and objects; None takes ``SIMPLE_ROS_TRANSPORTS`` (names separated by commas), else
            ``local,shm,unix,tcp``.

    Raises:
        ConfigError: It is empty, or an object is none; `plugins.UnknownPlugin` for a name.
    """
    if choice is None:
        text = os.environ.get("SIMPLE_ROS_TRANSPORTS", "")
        choice = [name.strip() for name in text.split(",") if name.strip()] or DEFAULT_TRANSPORTS
    if isinstance(choice, str):
        choice = (choice,)
    found = tuple(_transport(item) for item in choice)
    if not found:
        raise ConfigError("a node needs at least one transport, say ('tcp',)")
    return found


def _transport(item: str | Transport) -> Transport | InProcess:
    if item in [way.value for way in InProcess]:
        return InProcess(item)
    if isinstance(item, str) and item in _BUILT_IN:
        return _BUILT_IN[item]
    found = plugins.load(plugins.TRANSPORTS, item) if isinstance(item, str) else item
    made = found() if isinstance(found, type) else found
    if not isinstance(made, Transport):
        raise ConfigError(f"transport {item!r} is {made!r}, no simple_ros.net.transport.Transport")
    return made


@dataclass(frozen=True, slots=True)
class Way:
    """One way to a target."""

    transport: Transport
    address: str


def scheme_of(address: str) -> str:
    """The scheme of an address as nodes tell it; ``host:port`` means TCP."""
    scheme, separator, _ = address.partition("://")
    return scheme if separator else TcpTransport.scheme


def ways_to(
    target: Target, transports: Iterable[Transport | InProcess], *, needs_reliable: bool
) -> tuple[Way, ...]:
    """All ways to a target, most wanted first.

    Args:
        target: Who.
        transports: Those of this node, most wanted first.
        needs_reliable: Leave out those that may lose messages.
    """
    offered: dict[str, list[str]] = {TcpTransport.scheme: [join_address(*target.key)]}
    for address in target.addresses:
        offered.setdefault(scheme_of(address), []).append(address)
    return tuple(
        Way(transport, address)
        for transport in transports
        if isinstance(transport, Transport) and (transport.is_reliable or not needs_reliable)
        for address in offered.get(transport.scheme, ())
    )
