"""The sending end of a stream socket, written for one purpose: data flows out, and nothing is copied.

asyncio's own transport joins and copies what does not fit the socket at once, which for a camera image costs
more than sending it. This one keeps views of immutable bytes as they are, takes a message in several parts
(`writelines` is one system call), and tells at once when something had to wait.
"""

from __future__ import annotations

import asyncio
import logging
import socket
from collections import deque
from collections.abc import Iterable, Sequence
from typing import Any

from simple_ros.net.addresses import is_tcp, no_delay
from simple_ros.net.quick_loop import add_quick_reader

__all__ = ["StreamTransport", "connected", "connected_tcp"]

logger = logging.getLogger(__name__)

_MOST_PARTS = 256
_READ_BYTES = 65536
_NEAR_BUFFER_BYTES = 512 * 1024


class StreamTransport(asyncio.Transport):
    """A connected, non-blocking stream socket for a protocol that sends.

    `asyncio.Protocol.pause_writing` is called as soon as anything waits, `resume_writing` when nothing
    does. What is written is not copied if it is ``bytes``; other buffers are copied only as far as they
    have to wait, so they may be changed when `write` has returned. Those given to `lend_lines` are never
    copied: they may be changed after `asyncio.Protocol.resume_writing`, or after `keep_own`.

    Attributes:
        lends: Whether buffers that were lent are still needed.
    """

    def __init__(self, sock: socket.socket, protocol: asyncio.BaseProtocol) -> None:
        super().__init__({"socket": sock, "peername": _peer_of(sock)})
        self._loop = asyncio.get_running_loop()
        self._sock = sock
        self._fd = sock.fileno()
        self._protocol: Any = protocol
        self._waiting: deque[memoryview] = deque()
        self._closing = False
        self._lost = False
        self._is_near = _ends_here(sock)
        self.lends = False
        add_quick_reader(self._loop, self._fd, self._readable)

    # -- writing -------------------------------------------------------------------------------

    def write(self, data: Any) -> None:
        """Send, or keep what does not fit the socket."""
        if self._closing:
            return
        if self._waiting:
            self._keep(data, 0)
            return
        try:
            sent = self._sock.send(data)
        except (BlockingIOError, InterruptedError):
            sent = 0
        except OSError as error:
            self._fail(error)
            return
        if sent < len(data):
            self._keep(data, sent)
            self._wait()

    def writelines(self, list_of_data: Iterable[Any]) -> None:
        """Send several buffers as one."""
        self._write_parts(list(list_of_data))

    def lend_lines(self, parts: Sequence[Any]) -> None:
        """As `writelines`, without a copy: see `lends`."""
        self._write_parts(parts, is_lent=True)

    def keep_own(self) -> None:
        """Copy what was lent and still waits."""
        self.lends = False
        self._waiting = deque(
            view if isinstance(view.obj, bytes) else memoryview(bytes(view))
            for view in self._waiting
        )

    def _write_parts(self, parts: Sequence[Any], *, is_lent: bool = False) -> None:
        if self._closing:
            return
        if self._is_near:
            self._is_near = False
            _keep_in_caches(self._sock)
        sent = 0
        if not self._waiting:
            try:
                sent = self._sock.sendmsg(parts[:_MOST_PARTS])
            except (BlockingIOError, InterruptedError):
                sent = 0
            except OSError as error:
                self._fail(error)
                return
        was_waiting = bool(self._waiting)
        for part in parts:
            size = len(part)
            if sent < size:
                self._keep(part, sent, is_lent=is_lent)
            sent = max(0, sent - size)
        if self._waiting and not was_waiting:
            self._wait()

    def _keep(self, data: Any, sent: int, *, is_lent: bool = False) -> None:
        rest = memoryview(data)[sent:]
        if is_lent:
            self.lends = True
        elif not isinstance(data, bytes):
            rest = memoryview(bytes(rest))
        self._waiting.append(rest)

    def _wait(self) -> None:
        self._loop.add_writer(self._fd, self._writable)
        self._protocol.pause_writing()

    def _all_sent(self) -> None:
        """Nothing waits any more."""
        self._protocol.resume_writing()

    def _writable(self) -> None:
        waiting = self._waiting
        try:
            while waiting:
                parts = [waiting[index] for index in range(min(len(waiting), _MOST_PARTS))]
                sent = self._sock.sendmsg(parts)
                while waiting and sent >= len(waiting[0]):
                    sent -= len(waiting.popleft())
                if sent:
                    waiting[0] = waiting[0][sent:]
                    return
        except (BlockingIOError, InterruptedError):
            return
        except OSError as error:
            self._fail(error)
            return
        self._loop.remove_writer(self._fd)
        self.lends = False
        if self._closing:
            self._end(None)
        else:
            self._all_sent()

    def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None:
        """High water is always at zero."""

    def get_write_buffer_size(self) -> int:
        """Bytes that wait."""
        return sum(map(len, self._waiting))

    # -- reading -------------------------------------------------------------------------------

    def _readable(self) -> None:
        try:
            data = self._sock.recv(_READ_BYTES)
        except (BlockingIOError, InterruptedError):
            return
        except OSError as error:
            self._fail(error)
            return
        if data:
            self._received(data)
        else:
            self._end(None)

    def _received(self, data: bytes) -> None:
        self._protocol.data_received(data)

    # -- the end -------------------------------------------------------------------------------

    def is_closing(self) -> bool:
        """Whether it is closed, or about to be."""
        return self._closing

    def close(self) -> None:
        """Send what waits, then end."""
        if not self._closing:
            self._closing = True
            self._loop.remove_reader(self._fd)
            if not self._waiting:
                self._end(None)

    def abort(self) -> None:
        """End now."""
        self._end(None)

    def _fail(self, error: OSError) -> None:
        logger.debug("connection to %s: %s", self.get_extra_info("peername"), error)
        self._end(error)

    def _end(self, error: Exception | None) -> None:
        if self._lost:
            return
        self._lost = self._closing = True
        self.lends = False
        self._waiting.clear()
        self._loop.remove_reader(self._fd)
        self._loop.remove_writer(self._fd)
        self._loop.call_soon(self._finish, error)

    def _finish(self, error: Exception | None) -> None:
        try:
            self._protocol.connection_lost(error)
        finally:
            self._sock.close()


def _peer_of(sock: socket.socket) -> object:
    try:
        return sock.getpeername()
    except OSError:
        return None


def _ends_here(sock: socket.socket) -> bool:
    """Whether a TCP connection leads to this host."""
    if not is_tcp(sock):
        return False
    try:
        return bool(sock.getpeername()[0] == sock.getsockname()[0])
    except OSError:
        return False


def _keep_in_caches(sock: socket.socket) -> None:
    """Let little of a large message be under way at a time, for a connection inside this host.

    Left alone, Linux lets 4 MiB and more be under way. They leave the processors' caches before they are read; with half a
    megabyte, large messages took a third less time (1.6 times the rate at 1 MiB). Between hosts that much may be needed.
    """
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _NEAR_BUFFER_BYTES)


async def connected(family: int, address: Any) -> socket.socket:
    """A non-blocking stream socket, connected.

    Raises:
        OSError: Nobody answers.
    """
    sock = socket.socket(family, socket.SOCK_STREAM)
    try:
        sock.setblocking(False)
        await asyncio.get_running_loop().sock_connect(sock, address)
        no_delay(sock)
    except BaseException:
        sock.close()
        raise
    return sock


async def connected_tcp(host: str, port: int) -> socket.socket:
    """The same by TCP, to the first address of a host that answers.

    Raises:
        OSError: None does, or there is none.
    """
    problem = OSError(f"no address for {host!r}")
    for family, _, _, _, target in await _resolved(host, port):
        try:
            return await connected(family, target)
        except OSError as error:
            problem = error
    raise problem


async def _resolved(host: str, port: int) -> list[Any]:
    """Where a host is; one written in numbers needs no thread that asks."""
    try:
        return socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_NUMERICHOST | socket.AI_NUMERICSERV
        )
    except socket.gaierror:
        loop = asyncio.get_running_loop()
        return await loop.getaddrinfo(host, port, type=socket.SOCK_STREAM)
