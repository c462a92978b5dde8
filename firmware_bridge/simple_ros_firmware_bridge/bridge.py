"""The bridge: one node, any number of boards."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Self

from simple_ros.aio import NodeHandle
from simple_ros.diagnostics import DiagnosticUpdater
from simple_ros_firmware_bridge.board import Board
from simple_ros_firmware_bridge.config import BoardConfig
from simple_ros_firmware_bridge.tcp_boards import TcpBoards
from simple_ros_firmware_bridge.udp_boards import UdpBoards

__all__ = ["PicoBridge"]


class PicoBridge:
    """Boards with micro-ROS firmware as part of the graph.

    Args:
        node: A started node; the boards' topics are its.
        boards: Which boards.
        directory: Where sessions are kept so that a restart goes unnoticed by the boards; None for
            nowhere.
        udp_port: Boards may come over UDP, too; 0 takes any free port, None does not listen.
        tcp_port: The same for TCP.
        net_config: What topics of boards over UDP and TCP are called.
    """

    def __init__(
        self,
        node: NodeHandle,
        boards: Sequence[BoardConfig],
        directory: Path | None = None,
        udp_port: int | None = None,
        tcp_port: int | None = None,
        net_config: BoardConfig | None = None,
    ) -> None:
        self._node = node
        self._configs = boards
        self._directory = directory
        self._updater: DiagnosticUpdater | None = None
        self._udp_port = udp_port
        self._tcp_port = tcp_port
        self._net_config = net_config or BoardConfig()
        self.boards: list[Board] = []
        self.udp: UdpBoards | None = None
        self.tcp: TcpBoards | None = None

    async def start(self) -> Self:
        """Open the ports at once, whether or not there is a Master; then say how they are.

        Raises:
            OSError: The UDP or TCP port is taken.
        """
        self.boards = [Board(self._node, config, self._directory) for config in self._configs]
        try:
            await self._listen()
            self._updater = await DiagnosticUpdater.create(self._node)
        except BaseException:
            await self.close()
            raise
        for index, board in enumerate(self.boards):
            name = (
                f"board {board.name}" if len(self.boards) == 1 else f"board {index}: {board.name}"
            )
            self._updater.add(name, board.diagnose)
        if self.udp is not None:
            self._updater.add("udp", self.udp.boards.diagnose)
        if self.tcp is not None:
            self._updater.add("tcp", self.tcp.boards.diagnose)
        return self

    async def _listen(self) -> None:
        where = (self._node, self._net_config)
        if self._udp_port is not None:
            self.udp = await UdpBoards.listen(*where, self._udp_port, self._directory)
        if self._tcp_port is not None:
            self.tcp = await TcpBoards.listen(*where, self._tcp_port, self._directory)

    async def close(self) -> None:
        """Leave the ports."""
        if self._updater is not None:
            await self._updater.close()
        for board in self.boards:
            await board.close()
        if self.udp is not None:
            await self.udp.close()
        if self.tcp is not None:
            await self.tcp.close()

    async def __aenter__(self) -> Self:
        return await self.start()

    async def __aexit__(self, *_: object) -> None:
        await self.close()
