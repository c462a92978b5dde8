"""The connections of one publisher as flows: their 5-tuples, as they come and go."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable, Sequence
from typing import Any

from simple_ros.net.transport import (
    Acceptor,
    InProcess,
    Listener,
    Place,
    Transport,
    chosen_transports,
)
from simple_ros_engines.marking import Marks, marked
from simple_ros_engines.network_exposure.exposure.model import FiveTuple

__all__ = ["FlowSet", "flowing"]

_INTERNET = (socket.AF_INET, socket.AF_INET6)


class FlowSet:
    """The connections that stand.

    Args:
        on_change: Called with a flow that came (True) or went (False).
    """

    def __init__(self, on_change: Callable[[FiveTuple, bool], None]) -> None:
        self._flows: dict[int, FiveTuple] = {}
        self._on_change = on_change

    @property
    def all(self) -> tuple[FiveTuple, ...]:
        """Each."""
        return tuple(self._flows.values())

    def came(self, key: int, sock: socket.socket | None) -> None:
        """A connection stands; one that is no internet connection is no flow."""
        flow = None if sock is None else _five_tuple(sock)
        if flow is not None:
            self._flows[key] = flow
            self._on_change(flow, True)

    def went(self, key: int) -> None:
        """A connection has ended."""
        flow = self._flows.pop(key, None)
        if flow is not None:
            self._on_change(flow, False)


def _five_tuple(sock: socket.socket) -> FiveTuple | None:
    if sock.family not in _INTERNET:
        return None
    try:
        source, destination = sock.getsockname(), sock.getpeername()
    except OSError:
        # It was closed meanwhile; its end is told as well.
        return None
    protocol = "UDP" if sock.type == socket.SOCK_DGRAM else "TCP"
    return FiveTuple(protocol, source[0], source[1], destination[0], destination[1])


def flowing(
    schemes: Sequence[str], on_change: Callable[[FiveTuple, bool], None]
) -> tuple[tuple[Transport, ...], Marks, FlowSet]:
    """Transports for one publisher whose connections are flows, their marks, and the flows.

    Args:
        schemes: How messages may travel; what has no connection of its own (inside a process) is left out.
        on_change: Called with a flow that came (True) or went (False).
    """
    flows = FlowSet(on_change)
    ways = [way for way in chosen_transports(schemes) if not isinstance(way, InProcess)]
    shown, marks = marked(ways)
    return (
        tuple(_FlowTransport(way, flows) for way in shown if isinstance(way, Transport)),
        marks,
        flows,
    )


class _FlowTransport(Transport):
    """Another transport, whose connections are watched."""

    def __init__(self, inner: Transport, flows: FlowSet) -> None:
        self.scheme = inner.scheme  # type: ignore[misc]
        self.is_reliable = inner.is_reliable
        self.max_write_bytes = inner.max_write_bytes
        self._inner = inner
        self._flows = flows

    async def listen(self, accept: Acceptor, place: Place) -> Listener:
        return await self._inner.listen(accept, place)

    async def dial(self, address: str, protocol: asyncio.Protocol) -> None:
        await self._inner.dial(address, _Watcher(protocol, self._flows))


class _Watcher(asyncio.Protocol):
    """A protocol that tells when its connection begins and ends."""

    def __init__(self, inner: asyncio.Protocol, flows: FlowSet) -> None:
        self._inner = inner
        self._flows = flows
        self.pause_writing = inner.pause_writing  # type: ignore[method-assign]
        self.resume_writing = inner.resume_writing  # type: ignore[method-assign]
        self.data_received = inner.data_received  # type: ignore[method-assign]

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        sock: Any = transport.get_extra_info("socket")
        self._inner.connection_made(transport)
        self._flows.came(id(self), sock if hasattr(sock, "getpeername") else None)

    def connection_lost(self, exc: Exception | None) -> None:
        self._inner.connection_lost(exc)
        self._flows.went(id(self))
