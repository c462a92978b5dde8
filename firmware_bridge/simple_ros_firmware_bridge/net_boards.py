"""What boards over UDP and over TCP have in common: each address is one board, each has its session kept."""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Callable
from typing import Any

from simple_ros.aio import NodeHandle
from simple_ros.diagnostics import ERROR, OK, WARN, Status
from simple_ros_firmware_bridge.config import BoardConfig
from simple_ros_firmware_bridge.host import AgentHost
from simple_ros_firmware_bridge.memory_file import MemoryBook

__all__ = ["Address", "NetBoard", "NetBoards", "address_text", "bound_socket"]

logger = logging.getLogger(__name__)

_MAX_BOARDS = 64
_FORGOTTEN_S = 60.0
_LOOK_S = 5.0
_SILENT_S = 2.0 * _LOOK_S
_MOST_NAMED = 3

Address = tuple[Any, ...]
"""As sockets have it: host and port come first."""


def address_text(address: Address) -> str:
    """``192.168.1.20:8888``."""
    return f"{address[0]}:{address[1]}"


def bound_socket(kind: socket.SocketKind, host: str, port: int) -> socket.socket:
    """A socket on a port; 0 takes any free one.

    Raises:
        OSError: The port is taken; the error names it.
    """
    made = socket.socket(socket.AF_INET, kind)
    made.setblocking(False)
    if kind is socket.SOCK_STREAM:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        made.bind((host, port))
    except OSError as error:
        made.close()
        name = "TCP" if kind is socket.SOCK_STREAM else "UDP"
        raise OSError(error.errno, f"{name} port {port}: {error.strerror}") from None
    return made


class NetBoard:
    """One board. Made by `NetBoards.admit`.

    Args:
        boards: Those it is one of.
        address: Where it is.
        send: Sends a message to it.

    Attributes:
        heard_at: When it last said something.
        unanswered: How often it was asked for a sign of life since.
    """

    def __init__(self, boards: NetBoards, address: Address, send: Callable[[bytes], None]) -> None:
        self.address = address
        self.heard_at = boards.now()
        self.unanswered = 0
        self._boards = boards
        self._send_message = send
        text = address_text(address)
        self.host = AgentHost(
            boards.node,
            boards.config,
            f"{boards.kind} {text}",
            boards.book.page(text),
            self._send,
            lambda: True,
        )

    def received(self, message: bytes) -> None:
        """A message of it."""
        now = self.heard_at = self._boards.now()
        self.unanswered = 0
        self.host.agent.receive(message, now)
        self.host.worked(now)

    def _send(self) -> None:
        for message in self.host.agent.data_to_send():
            self._send_message(message)


class NetBoards:
    """The boards of one port, by address.

    Args:
        kind: ``udp`` or ``tcp``, for names.
        node: The node they belong to.
        config: What their topics are called; the same for all.
        book: Where their sessions are kept.
        forget: Called with a board that was silent for a minute, before it is closed.
    """

    def __init__(
        self,
        kind: str,
        node: NodeHandle,
        config: BoardConfig,
        book: MemoryBook,
        forget: Callable[[Address], None] = lambda _: None,
    ) -> None:
        self.kind = kind
        self.node = node
        self.config = config
        self.book = book
        self.refused = 0
        self._forget = forget
        self._boards: dict[Address, NetBoard] = {}
        self._loop = asyncio.get_running_loop()
        self._closing: set[asyncio.Task[None]] = set()
        self._looking = self._loop.call_later(_LOOK_S, self._look)

    def now(self) -> float:
        """Seconds of the clock that agents go by."""
        return self._loop.time()

    def at(self, address: Address) -> NetBoard | None:
        """The board at an address."""
        return self._boards.get(address)

    def admit(self, address: Address, send: Callable[[bytes], None]) -> NetBoard | None:
        """A new board; None if there are too many.

        Whoever never began a session makes room: it may be anybody.
        """
        if len(self._boards) >= _MAX_BOARDS and not self._made_room():
            self.refused += 1
            return None
        board = self._boards[address] = NetBoard(self, address, send)
        board.host.flush()
        return board

    def _made_room(self) -> bool:
        idle = [board for board in self._boards.values() if board.host.agent.session is None]
        if not idle:
            return False
        last = min(idle, key=lambda board: board.heard_at)
        self._forget(last.address)
        self.drop(last.address)
        return True

    def drop(self, address: Address) -> None:
        """This board is not there any more; its session is kept."""
        board = self._boards.pop(address, None)
        if board is not None:
            task = self._loop.create_task(board.host.close())
            self._closing.add(task)
            task.add_done_callback(self._closing.discard)

    def _look(self) -> None:
        self._looking = self._loop.call_later(_LOOK_S, self._look)
        now = self.now()
        for address, board in list(self._boards.items()):
            if now - board.heard_at <= _LOOK_S / 2:
                continue
            # What counts is how often it did not answer: this computer may have slept, too.
            if board.unanswered * _LOOK_S >= _FORGOTTEN_S:
                logger.info("board %s: silent for a minute, forgotten", board.host.name)
                self._forget(address)
                self.drop(address)
            else:
                board.unanswered += 1
                board.host.probe()

    def diagnose(self, status: Status) -> None:
        """A task of a `DiagnosticUpdater`."""
        now = self.now()
        boards = [it for it in self._boards.values() if it.host.agent.session is not None]
        status.summary(OK, f"{len(boards)} boards")
        silent = [it.host.name for it in boards if now - it.heard_at > _SILENT_S]
        if silent:
            more = f" and {len(silent) - _MOST_NAMED} more" if len(silent) > _MOST_NAMED else ""
            status.merge_summary(WARN, f"silent: {', '.join(silent[:_MOST_NAMED])}{more}")
        for board in boards:
            status.add("board", board.host.name)
            board.host.add_values(status)
        status.add("addresses without a session", len(self._boards) - len(boards))
        refused, self.refused = self.refused, 0
        if refused:
            status.merge_summary(ERROR, f"more than {_MAX_BOARDS} boards at once")

    async def close(self) -> None:
        """Leave all of them; their sessions are kept."""
        self._looking.cancel()
        for address in list(self._boards):
            self.drop(address)
        await asyncio.gather(*self._closing)
