"""Boards that come over UDP, such as those with Wi-Fi: a datagram is one XRCE message."""

from __future__ import annotations

import asyncio
import functools
import logging
import socket
from pathlib import Path
from typing import cast

from simple_ros.aio import NodeHandle
from simple_ros_firmware_bridge.config import BoardConfig
from simple_ros_firmware_bridge.memory_file import MemoryBook
from simple_ros_firmware_bridge.net_boards import Address, NetBoard, NetBoards, bound_socket

__all__ = ["UdpBoards"]

logger = logging.getLogger(__name__)


class UdpBoards(asyncio.DatagramProtocol):
    """Listens on a port; made by `UdpBoards.listen`.

    Args:
        boards: Where they are kept.
        port: Where it listens.
    """

    def __init__(self, boards: NetBoards, port: int) -> None:
        self.boards = boards
        self.port = port
        self._transport: asyncio.DatagramTransport | None = None

    @classmethod
    async def listen(
        cls,
        node: NodeHandle,
        config: BoardConfig,
        port: int,
        directory: Path | None = None,
        host: str = "0.0.0.0",
    ) -> UdpBoards:
        """Begin to listen; boards of the last run are asked at once where they are.

        Args:
            node: The node they belong to.
            config: What their topics are called; the same for all.
            port: Where; 0 takes any free one.
            directory: Where sessions are kept; None for nowhere.
            host: Address to listen on.

        Raises:
            OSError: The port is taken.
        """
        bound = bound_socket(socket.SOCK_DGRAM, host, port)
        number = int(bound.getsockname()[1])
        boards = NetBoards("udp", node, config, MemoryBook(directory, f"udp_{number}"))
        _, made = await asyncio.get_running_loop().create_datagram_endpoint(
            lambda: cls(boards, number), sock=bound
        )
        for text in boards.book.addresses():
            name, _, peer = text.rpartition(":")
            made._admit((name, int(peer)))
        logger.info("boards may come over UDP to port %d", number)
        return made

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """As asyncio says."""
        self._transport = cast("asyncio.DatagramTransport", transport)

    def datagram_received(self, data: bytes, addr: Address) -> None:
        """As asyncio says."""
        board = self.boards.at(addr) or self._admit(addr)
        if board is not None:
            board.received(data)

    def _admit(self, address: Address) -> NetBoard | None:
        return self.boards.admit(address, functools.partial(self._send, address))

    def error_received(self, exc: Exception) -> None:
        """As asyncio says: a board is not there (any more), which its silence tells as well."""
        logger.debug("UDP: %s", exc)

    def _send(self, address: Address, message: bytes) -> None:
        if self._transport is not None and not self._transport.is_closing():
            self._transport.sendto(message, address)

    async def close(self) -> None:
        """Leave the port."""
        await self.boards.close()
        if self._transport is not None:
            self._transport.close()
