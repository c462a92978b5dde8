"""Boards that come over TCP: each connection is one board."""

from __future__ import annotations

import asyncio
import logging
import socket
from pathlib import Path
from typing import cast

from simple_ros.aio import NodeHandle
from simple_ros_firmware_bridge.config import BoardConfig
from simple_ros_firmware_bridge.memory_file import MemoryBook
from simple_ros_firmware_bridge.net_boards import (
    Address,
    NetBoard,
    NetBoards,
    address_text,
    bound_socket,
)
from simple_ros_firmware_bridge.tcp_framing import MessageReader, encode_message

__all__ = ["TcpBoards"]

logger = logging.getLogger(__name__)

_MAX_WAITING = 65536


class _Connection(asyncio.Protocol):
    def __init__(self, boards: TcpBoards) -> None:
        self._boards = boards
        self._reader = MessageReader()
        self._board: NetBoard | None = None
        self._address: Address = ()
        self.transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = cast("asyncio.Transport", transport)
        self._address = transport.get_extra_info("peername")
        self._board = self._boards.arrived(self._address, self)
        if self._board is None:
            self.transport.abort()

    def data_received(self, data: bytes) -> None:
        if self._board is None:
            return
        for message in self._reader.feed(data):
            self._board.received(message)

    def send(self, message: bytes) -> None:
        transport = self.transport
        if transport is None or transport.is_closing():
            return
        # A board that does not read must not fill our memory: it is asked what it has when it reads again.
        if transport.get_write_buffer_size() <= _MAX_WAITING:
            transport.write(encode_message(message))

    def connection_lost(self, _exc: Exception | None) -> None:
        self._boards.left(self._address)


class TcpBoards:
    """Listens on a port; made by `TcpBoards.listen`.

    A board that lost its connection comes back from another port. It gets its session again if it is the only one
    of its host whose session is free; where that is not certain it begins anew.

    Args:
        node: The node they belong to.
        config: What their topics are called; the same for all.
        book: Where sessions are kept.
        port: Where it listens.
    """

    def __init__(self, node: NodeHandle, config: BoardConfig, book: MemoryBook, port: int) -> None:
        self.boards = NetBoards("tcp", node, config, book, self._cut)
        self.port = port
        self._connections: dict[Address, _Connection] = {}
        self._server: asyncio.Server | None = None

    @classmethod
    async def listen(
        cls,
        node: NodeHandle,
        config: BoardConfig,
        port: int,
        directory: Path | None = None,
        host: str = "0.0.0.0",
    ) -> TcpBoards:
        """Begin to listen.

        Args:
            node: The node they belong to.
            config: What their topics are called; the same for all.
            port: Where; 0 takes any free one.
            directory: Where sessions are kept; None for nowhere.
            host: Address to listen on.

        Raises:
            OSError: The port is taken.
        """
        bound = bound_socket(socket.SOCK_STREAM, host, port)
        number = int(bound.getsockname()[1])
        made = cls(node, config, MemoryBook(directory, f"tcp_{number}"), number)
        made._server = await asyncio.get_running_loop().create_server(
            lambda: _Connection(made), sock=bound
        )
        logger.info("boards may come over TCP to port %d", number)
        return made

    def arrived(self, address: Address, connection: _Connection) -> NetBoard | None:
        """A board connected; None if there are too many."""
        self._claim_session(address)
        board = self.boards.admit(address, connection.send)
        if board is not None:
            self._connections[address] = connection
        return board

    def _claim_session(self, address: Address) -> None:
        connected = {address_text(other) for other in self._connections}
        free = [
            text
            for text in self.boards.book.addresses()
            if text not in connected and text.rpartition(":")[0] == address[0]
        ]
        if len(free) == 1:
            self.boards.book.move(free[0], address_text(address))

    def left(self, address: Address) -> None:
        """A connection ended; the session is kept."""
        if self._connections.pop(address, None) is not None:
            logger.info("board tcp %s: its connection ended", address_text(address))
            self.boards.drop(address)

    def _cut(self, address: Address) -> None:
        connection = self._connections.pop(address, None)
        if connection is not None and connection.transport is not None:
            connection.transport.abort()

    async def close(self) -> None:
        """Leave the port."""
        if self._server is not None:
            self._server.close()
        for address in list(self._connections):
            self._cut(address)
        await self.boards.close()
