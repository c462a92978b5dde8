"""Boards that come over UDP, such as those with Wi-Fi: each address is one board."""

from __future__ import annotations

import asyncio
import logging
from typing import Any, cast

from simple_ros.aio import NodeHandle
from simple_ros.diagnostics import ERROR, OK, WARN, Status
from simple_ros_firmware_bridge.config import BoardConfig
from simple_ros_firmware_bridge.host import AgentHost
from simple_ros_firmware_bridge.memory_file import MemoryFile

__all__ = ["UdpBoards"]

logger = logging.getLogger(__name__)

_MAX_BOARDS = 64
_FORGOTTEN_S = 60.0
_SILENT_S = 2.0

Address = tuple[Any, ...]


class _Peer:
    def __init__(self, boards: UdpBoards, address: Address, now: float) -> None:
        self._boards = boards
        self._address = address
        self.heard_at = now
        name = f"udp {address[0]}:{address[1]}"
        self.host = AgentHost(
            boards.node, boards.config, name, MemoryFile(None, ""), self._send, lambda: True
        )

    def received(self, data: bytes, now: float) -> None:
        self.heard_at = now
        self.host.agent.receive(data, now)
        self.host.worked(now)

    def _send(self) -> None:
        for message in self.host.agent.data_to_send():
            self._boards.send(message, self._address)


class UdpBoards(asyncio.DatagramProtocol):
    """Listens on a port; made by `UdpBoards.listen`. A datagram is one XRCE message.

    Args:
        node: The node they belong to.
        config: What their topics are called; the same for all.
    """

    def __init__(self, node: NodeHandle, config: BoardConfig) -> None:
        self.node = node
        self.config = config
        self._peers: dict[Address, _Peer] = {}
        self._transport: asyncio.DatagramTransport | None = None
        self._loop = asyncio.get_running_loop()
        self._closing: set[asyncio.Task[None]] = set()
        self.refused = 0

    @classmethod
    async def listen(
        cls, node: NodeHandle, config: BoardConfig, port: int, host: str = "0.0.0.0"
    ) -> UdpBoards:
        """Begin to listen; ``port`` 0 takes any free one.

        Raises:
            OSError: The port is taken.
        """
        _, boards = await asyncio.get_running_loop().create_datagram_endpoint(
            lambda: cls(node, config), local_addr=(host, port)
        )
        logger.info("boards may come over UDP to port %d", boards.port)
        return boards

    @property
    def port(self) -> int:
        """The port it listens on."""
        assert self._transport is not None
        return int(self._transport.get_extra_info("sockname")[1])

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """As asyncio says."""
        self._transport = cast("asyncio.DatagramTransport", transport)

    def datagram_received(self, data: bytes, addr: Address) -> None:
        """As asyncio says."""
        now = self._loop.time()
        peer = self._peers.get(addr)
        if peer is None:
            self._forget_silent(now)
            if len(self._peers) >= _MAX_BOARDS:
                self.refused += 1
                return
            peer = self._peers[addr] = _Peer(self, addr, now)
        peer.received(data, now)

    def error_received(self, exc: Exception) -> None:
        """As asyncio says: a board is not there (any more), which its silence tells as well."""
        logger.debug("UDP: %s", exc)

    def send(self, data: bytes, address: Address) -> None:
        """A message to a board."""
        if self._transport is not None and not self._transport.is_closing():
            self._transport.sendto(data, address)

    def _forget_silent(self, now: float) -> None:
        for address, peer in list(self._peers.items()):
            if now - peer.heard_at > _FORGOTTEN_S:
                del self._peers[address]
                task = self._loop.create_task(peer.host.close())
                self._closing.add(task)
                task.add_done_callback(self._closing.discard)

    def diagnose(self, status: Status) -> None:
        """A task of a `DiagnosticUpdater`."""
        now = self._loop.time()
        status.summary(OK, f"{len(self._peers)} boards")
        for peer in self._peers.values():
            if now - peer.heard_at > _SILENT_S:
                status.merge_summary(WARN, f"{peer.host.name} is silent")
            status.add("board", peer.host.name)
            peer.host.add_values(status)
        if self.refused:
            status.merge_summary(ERROR, f"more than {_MAX_BOARDS} boards at once")

    async def close(self) -> None:
        """Leave the port."""
        if self._transport is not None:
            self._transport.close()
        for peer in self._peers.values():
            await peer.host.close()
