"""The receiving end of a stream socket: reads into the buffer of its protocol, with nothing in between.

It does what asyncio's own transport does for a `asyncio.BufferedProtocol`, in one call from the event loop on, and
asks for a buffer only when the one it has was used.
"""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable
from typing import Protocol

from simple_ros.net.addresses import no_delay
from simple_ros.net.quick_loop import add_quick_reader
from simple_ros.net.stream import StreamTransport

__all__ = ["InboundStream", "ReadsIntoRoom", "take_connection"]


class ReadsIntoRoom(Protocol):
    """A buffered protocol that may know early where the next bytes go.

    Attributes:
        room: Where; None: ask ``get_buffer``.
    """

    room: memoryview | None

    def get_buffer(self, sizehint: int) -> memoryview:
        """Where the next bytes go."""

    def buffer_updated(self, nbytes: int) -> None:
        """So many have come."""


class InboundStream(StreamTransport):
    """A connected, non-blocking stream socket for a protocol that receives, and may answer.

    What the peer has ended is ended here, too, once what waits was sent.
    """

    def __init__(self, sock: socket.socket, protocol: asyncio.BufferedProtocol) -> None:
        self._recv_into = sock.recv_into
        self._reader: ReadsIntoRoom = protocol  # type: ignore[assignment]
        self._reads = True
        super().__init__(sock, protocol)

    def _readable(self) -> None:
        reader = self._reader
        room = reader.room
        try:
            count = self._recv_into(reader.get_buffer(-1) if room is None else room)
        except (BlockingIOError, InterruptedError):
            return
        except OSError as error:
            self._fail(error)
            return
        if not count:
            self.close()
            return
        try:
            reader.buffer_updated(count)
        except Exception as error:
            self._loop.call_exception_handler(
                {
                    "message": "what came on a connection could not be taken; it ends",
                    "exception": error,
                    "transport": self,
                    "protocol": self._protocol,
                }
            )
            self._end(error)

    def is_reading(self) -> bool:
        """Whether it reads, or would if something came."""
        return self._reads and not self._closing

    def pause_reading(self) -> None:
        """Leave what comes with the kernel."""
        if self.is_reading():
            self._reads = False
            self._loop.remove_reader(self._fd)

    def resume_reading(self) -> None:
        """Read on."""
        if not self._reads and not self._closing:
            self._reads = True
            add_quick_reader(self._loop, self._fd, self._readable)


async def take_connection(
    accept: Callable[[], asyncio.BufferedProtocol], connection: socket.socket
) -> None:
    """Let a protocol that ``accept`` makes read a connection, one that was accepted or dialled.

    Raises:
        OSError: It ended before it began.
    """
    loop = asyncio.get_running_loop()
    if not isinstance(loop, asyncio.SelectorEventLoop):
        await loop.connect_accepted_socket(accept, connection)
        return
    no_delay(connection)
    protocol = accept()
    stream = InboundStream(connection, protocol)
    try:
        protocol.connection_made(stream)
    except BaseException:
        stream.abort()
        raise
