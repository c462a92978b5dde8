"""How a process is seen to be ready: by a datagram from it, or by its node at the Master."""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
from collections.abc import AsyncIterator, Callable
from pathlib import Path

from simple_ros.errors import MasterUnavailable
from simple_ros.graph import ChangeKind, GraphSnapshot
from simple_ros.net.master_client import ForeignMaster, MasterClient

__all__ = ["NotifySocket", "watch_nodes"]

_MOST_BYTES = 4096
_AGAIN_S = 0.3


class NotifySocket:
    """Hears ``READY=1`` of one process (sd_notify's protocol).

    Args:
        path: Where to make the socket; it goes to the process as ``NOTIFY_SOCKET``.
        on_ready: Called each time the process says so.
    """

    def __init__(self, path: Path, on_ready: Callable[[], None]) -> None:
        self.path = path
        self._on_ready = on_ready
        self._loop = asyncio.get_running_loop()
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        path.unlink(missing_ok=True)
        self._socket.bind(os.fspath(path))
        self._loop.add_reader(self._socket, self._read)

    def _read(self) -> None:
        try:
            datagram = self._socket.recv(_MOST_BYTES)
        except BlockingIOError:
            return
        if b"READY=1" in datagram.split(b"\n"):
            self._on_ready()

    def close(self) -> None:
        """Hear no more."""
        self._loop.remove_reader(self._socket)
        self._socket.close()
        self.path.unlink(missing_ok=True)


async def watch_nodes(master: str, on_node: Callable[[str], None]) -> None:
    """Call ``on_node`` with the name of every node the Master knows or comes to know; for ever.

    Args:
        master: ``host:port``. If it goes away, its return is awaited. With a C++ Master, which
            tells no changes, the same name may be called again and again.
        on_node: Gets canonical names.
    """
    while True:
        async with MasterClient(master) as client:
            with contextlib.suppress(MasterUnavailable):
                async for name in _names(client):
                    on_node(name)
        await asyncio.sleep(_AGAIN_S)


async def _names(client: MasterClient) -> AsyncIterator[str]:
    try:
        async for event in client.watch_graph():
            if isinstance(event, GraphSnapshot):
                for node in event.nodes:
                    yield node.name
            elif event.kind is ChangeKind.NODE_ADDED:
                yield event.node
    except ForeignMaster:
        for info in await client.get_nodes():
            yield info.node_name.lstrip("/")
