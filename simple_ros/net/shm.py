"""Shared memory between processes of one host: large messages are copied once and read where they lie.

A link is a Unix socket. When it is made, the publisher sends along the file of its `Arena`. From then on, what is large
is put into a slot there, and the socket carries a few bytes that say where; all else goes through the
socket as ever, in the same order. Where no slot is free (a subscriber keeps many messages, or the limit
is reached), large messages go through the socket too.

Addresses are ``shm://HOST/NAME``; peers that do not know the scheme take the next way.
"""

from __future__ import annotations

import asyncio
import logging
import os
import socket
import struct
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Protocol
from weakref import WeakKeyDictionary

from simple_ros.net import arena as arenas
from simple_ros.net.arena import Arena, ArenaReader, Window
from simple_ros.net.stream import StreamTransport
from simple_ros.net.unix import UnixListener, connected_unix
from simple_ros.net.unix import is_available as unix_is_available
from simple_ros.wire.framing import LENT_BYTES, Run
from simple_ros.wire.slots import MOST_READERS, SLOT_HEADER, SlotRef, frames_in

__all__ = ["ShmListener", "SlotReader", "dial_shm", "is_available"]

logger = logging.getLogger(__name__)

_GREETING = struct.Struct(">8s16sI4x")
_MAGIC = b"srosshm1"
_GREETING_TIMEOUT_S = 5.0
_PID = struct.Struct("3i")
_WAKE = b"\1"

_arenas: WeakKeyDictionary[asyncio.AbstractEventLoop, Arena] = WeakKeyDictionary()


def is_available() -> bool:
    """Whether this system can do it, and ``SIMPLE_ROS_SHM_MB`` is not 0."""
    return unix_is_available() and arenas.is_available() and arenas.limit_bytes() > 0


# -- the publisher's side ------------------------------------------------------------------------


async def dial_shm(address: str, protocol: asyncio.Protocol) -> None:
    """Connect to a name of this host and share memory with it.

    Raises:
        OSError: It is another host's, nobody listens, or memory cannot be shared with it.
    """
    if not is_available():
        raise OSError("this system shares no memory")
    sock = await connected_unix(address)
    try:
        reader = _arena().join(_peer_pid(sock))
        try:
            greeting = _GREETING.pack(_MAGIC, reader.arena.identity, reader.number)
            # The first thing on a new connection always fits its buffer.
            socket.send_fds(sock, [greeting], [reader.arena.fd])
        except OSError:
            _leave(reader)
            raise
    except BaseException:
        sock.close()
        raise
    protocol.connection_made(_ShmStream(sock, protocol, reader))


def _arena() -> Arena:
    loop = asyncio.get_running_loop()
    found = _arenas.get(loop)
    if found is None:
        found = _arenas[loop] = Arena(arenas.limit_bytes())
    return found


def _leave(reader: ArenaReader) -> None:
    """The last reader that leaves takes the memory along."""
    arena = reader.arena
    arena.leave(reader)
    if arena.is_unused:
        for loop in [loop for loop, other in _arenas.items() if other is arena]:
            del _arenas[loop]
        arena.close()


def _peer_pid(sock: socket.socket) -> int:
    pid = int(_PID.unpack(sock.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PID.size))[0])
    if pid <= 0:
        raise OSError("the peer's process cannot be seen from here (another PID namespace)")
    return pid


class _ShmStream(StreamTransport):
    """Sends large writes by way of shared memory."""

    def __init__(
        self, sock: socket.socket, protocol: asyncio.Protocol, reader: ArenaReader
    ) -> None:
        super().__init__(sock, protocol)
        self._reader = reader
        self._behind = False

    def write(self, data: Any) -> None:
        """Send, or keep what does not fit."""
        if len(data) < LENT_BYTES or not self._announced((data,)):
            super().write(data)

    def writelines(self, list_of_data: Iterable[Any]) -> None:
        """Send several buffers as one."""
        parts = list_of_data if isinstance(list_of_data, tuple) else tuple(list_of_data)
        if sum(map(len, parts)) < LENT_BYTES or not self._announced(parts):
            super().writelines(parts)

    def lend_lines(self, parts: Sequence[Any]) -> None:
        """As `writelines`, without a further copy."""
        if sum(map(len, parts)) < LENT_BYTES or not self._announced(parts):
            super().lend_lines(parts)

    def _announced(self, parts: Sequence[Any]) -> bool:
        """Put it into a slot and say so; False if there is none."""
        if self._closing:
            return True
        frame = self._reader.announce(parts)
        if frame is None:
            return False
        # Other links may be given the same object now, with the same content; later, with another.
        self._loop.call_soon(self._reader.arena.forget_last)
        super().write(frame)
        if not self._behind and self._reader.is_behind_for_now():
            self._behind = True
            self._protocol.pause_writing()
        return True

    def _received(self, data: bytes) -> None:  # noqa: ARG002
        """The reader has handed something on."""
        if self._behind and not self._reader.is_behind_for_now():
            self._behind = False
            if not self._waiting and not self._closing:
                self._protocol.resume_writing()

    def _all_sent(self) -> None:
        if not self._behind:
            super()._all_sent()

    def _finish(self, error: Exception | None) -> None:
        _leave(self._reader)
        super()._finish(error)


# -- the subscriber's side -----------------------------------------------------------------------


class SlotReader:
    """Finds what a link says lies in shared memory.

    Args:
        window: To the publisher's memory.
        number: Which of its readers this link is.
        write: Sends bytes to the publisher.
    """

    def __init__(self, window: Window, number: int, write: Callable[[bytes], object]) -> None:
        self._window = window
        self._number = number
        self._write = write
        self._under_way: list[int] = []

    def translate(self, runs: list[Run], max_message_bytes: int) -> list[Run]:
        """Put what lies in slots in place of the frames that stand for it.

        Raises:
            FrameError: A slot does not exist, or does not hold frames.
        """
        if all(run.header != SLOT_HEADER for run in runs):
            return runs
        found: list[Run] = []
        for run in runs:
            if run.header != SLOT_HEADER:
                found.append(run)
                continue
            for payload in run.payloads:
                ref = SlotRef.parse(payload)
                self._under_way.append(ref.slot)
                found += frames_in(self._window.take(ref, self._number), max_message_bytes)
        return found

    def handed_on(self) -> None:
        """All that was translated has been delivered."""
        if self._under_way:
            slots, self._under_way = self._under_way, []
            if self._window.handed_on(slots, self._number):
                self._write(_WAKE)


class SharesMemory(Protocol):
    """What a receiving protocol has to offer: a place for its `SlotReader`."""

    slots: SlotReader | None

    def write(self, data: bytes) -> None:
        """Send to the peer."""


class ShmListener(UnixListener):
    """Takes connections under a name, each with a file of shared memory."""

    scheme = "shm"

    async def _take(self, connection: socket.socket) -> None:
        try:
            async with asyncio.timeout(_GREETING_TIMEOUT_S):
                window, number = await self._greeted(connection)
        except (OSError, TimeoutError) as error:
            logger.debug("a connection brought no shared memory: %s", error)
            connection.close()
            return
        except asyncio.CancelledError:
            connection.close()
            raise

        def accept() -> asyncio.BufferedProtocol:
            link: Any = self._accept()
            link.slots = SlotReader(window, number, link.write)
            return link  # type: ignore[no-any-return]

        await self._attach(accept, connection)

    async def close(self) -> None:
        """Take no more; who has not greeted yet is not waited for."""
        for task in self._accepting:
            task.cancel()
        await super().close()

    async def _greeted(self, connection: socket.socket) -> tuple[Window, int]:
        readable = asyncio.Event()
        self._loop.add_reader(connection, readable.set)
        try:
            await readable.wait()
        finally:
            self._loop.remove_reader(connection)
        data, fds, _, _ = socket.recv_fds(connection, _GREETING.size, 1, socket.MSG_CMSG_CLOEXEC)
        try:
            magic, identity, number = _GREETING.unpack(data)
            if magic != _MAGIC or number >= MOST_READERS or len(fds) != 1:
                raise OSError("it was greeted in another way")
            return Window.shared(identity, fds.pop()), number
        except struct.error as error:
            raise OSError(str(error)) from error
        finally:
            for fd in fds:
                os.close(fd)
