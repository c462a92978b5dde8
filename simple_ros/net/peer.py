"""Outgoing data links: a publisher's connection to one subscriber.

One connection per topic and subscriber, as in C++ simple_ros, so that every flow has its own
5-tuple. Unsent messages wait in a `BoundedQueue` of ours, never in the transport's buffer, which
holds at most the one chunk that is being sent: so what is given up under congestion is the oldest
message, and memory is bounded in messages and bytes.
"""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Callable, Sequence
from typing import Any, cast

from simple_ros.loans import Loan
from simple_ros.net.addresses import connection_state, join_address, keep_alive
from simple_ros.net.stream import StreamTransport
from simple_ros.net.transport import TCP, InProcess, Transport, Way, ways_to
from simple_ros.qos import QosProfile, Reliability
from simple_ros.wire.queues import BoundedQueue
from simple_ros.wire.session import Backoff, Target

__all__ = ["OutboundLink"]

logger = logging.getLogger(__name__)

_CHUNK_BYTES = 256 * 1024
_DIAL_TIMEOUT_S = 5.0
_CHECK_EVERY_S = 2.0


class OutboundLink(asyncio.Protocol):
    """Dials a target, keeps dialling, sends what it is given.

    Attributes:
        target: Who is at the other end.
        queue: What waits, with its drop counters.
        connects: How often the link came up.
        sent: Messages handed to the network.
        too_large: Messages given up because the transport takes none of that size.
        turns: How often all that waited in the transport was sent, or lost with it.
    """

    def __init__(
        self,
        target: Target,
        profile: QosProfile,
        *,
        on_up: Callable[[OutboundLink], None],
        on_broken: Callable[[OutboundLink], None],
        on_room: Callable[[], None],
        transports: Sequence[Transport | InProcess] = (TCP,),
    ) -> None:
        self.target = target
        self.queue: BoundedQueue[bytes] = BoundedQueue(profile.depth, profile.max_bytes)
        self.connects = 0
        self.sent = 0
        self.too_large = 0
        self.turns = 0
        self._keeps_over_breaks = profile.reliability is Reliability.RELIABLE
        self._ways = ways_to(target, transports, needs_reliable=self._keeps_over_breaks)
        self._way: Way | None = None
        self._max_write: int | None = None
        self._on_up = on_up
        self._on_broken = on_broken
        self._on_room = on_room
        self._loop = asyncio.get_running_loop()
        self._transport: asyncio.Transport | None = None
        self._write: Callable[[bytes], object] = _nowhere
        self._direct = False
        self._paused = False
        self._closed = False
        self._check: asyncio.TimerHandle | None = None
        self._lost = asyncio.Event()
        self._idle = asyncio.Event()
        self._idle.set()
        self._backoff = Backoff()
        self._task = self._loop.create_task(self._keep_linked(), name=f"link to {target.node}")

    @property
    def is_up(self) -> bool:
        """Whether a connection stands."""
        return self._transport is not None

    # -- sending -------------------------------------------------------------------------------

    def send(self, frames: Sequence[bytes], joined: bytes, expires_at: float = math.inf) -> None:
        """Send or queue frames; ``joined`` is all of them in one piece."""
        if self._direct:
            self.sent += len(frames)
            assert self._transport is not None
            if self._max_write is None:
                self._write(joined)
            else:
                self._write_in_pieces(frames)
            if self._check is None:
                self._check = self._loop.call_later(_CHECK_EVERY_S, self._check_peer)
            return
        if self._closed:
            return
        self._idle.clear()
        self.queue.push_all(frames, map(len, frames), expires_at)

    @property
    def write_lone(self) -> Callable[[bytes], object] | None:
        """Sends a frame that comes alone, as long as `takes_any`; None if that goes the way of all others."""
        return self._write_lone if self._direct and self._max_write is None else None

    def _write_lone(self, frame: bytes) -> None:
        self.sent += 1
        self._write(frame)
        if self._check is None:
            self._check = self._loop.call_later(_CHECK_EVERY_S, self._check_peer)

    def send_parts(
        self, parts: tuple[Any, ...], expires_at: float = math.inf, loan: Loan | None = None
    ) -> None:
        """Send or queue one large frame, given as several buffers, which a ``loan`` may lend."""
        if self._direct and self._max_write is None:
            self.sent += 1
            assert self._transport is not None
            if loan is not None and isinstance(self._transport, StreamTransport):
                self._transport.lend_lines(parts)
                if self._transport.lends:
                    loan.add(self)
            else:
                self._transport.writelines(parts)
            if self._check is None:
                self._check = self._loop.call_later(_CHECK_EVERY_S, self._check_peer)
        else:
            joined = b"".join(parts)
            self.send((joined,), joined, expires_at)

    def keep_own(self) -> None:
        """Copy what was lent and is still under way."""
        if isinstance(self._transport, StreamTransport):
            self._transport.keep_own()

    @property
    def is_busy(self) -> bool:
        """Whether it is linked and still sends what came before."""
        return self._transport is not None and not self._direct

    @property
    def takes_any(self) -> bool:
        """Whether everything goes straight to the network for now."""
        return self._direct

    def has_room(self, size: int, count: int = 1) -> bool:
        """Whether ``count`` messages of ``size`` bytes in all can go with none given up."""
        return self._direct or self.queue.has_room(size, count)

    def _drain(self) -> None:
        transport = self._transport
        if transport is not None:
            # Each write may pause us.
            while self.queue and not self._is_paused():
                frames = self.queue.take(self._loop.time(), _CHUNK_BYTES)
                self.sent += len(frames)
                if self._max_write is None:
                    self._write(b"".join(frames))
                else:
                    self._write_in_pieces(frames)
            if not self._is_paused():
                self._direct = True
                self._idle.set()
            if self._check is None:
                self._check = self._loop.call_later(_CHECK_EVERY_S, self._check_peer)
        self._on_room()

    def _write_in_pieces(self, frames: Sequence[bytes]) -> None:
        """Write whole frames, as many at a time as the transport takes."""
        assert self._max_write is not None
        piece: list[bytes] = []
        size = 0
        for frame in frames:
            if len(frame) > self._max_write:
                self._give_up(frame)
                continue
            if size + len(frame) > self._max_write:
                self._write(b"".join(piece))
                piece, size = [], 0
            piece.append(frame)
            size += len(frame)
        if piece:
            self._write(b"".join(piece))

    def _give_up(self, frame: bytes) -> None:
        self.sent -= 1
        self.too_large += 1
        if self.too_large == 1:
            assert self._way is not None
            logger.warning(
                "%s takes at most %s bytes at once: dropping a message of %d bytes to %s (logged once)",
                self._way.transport.scheme,
                self._max_write,
                len(frame),
                self._who(),
            )

    def _check_peer(self) -> None:
        """End a link whose peer host no longer answers; look again while something is under way."""
        self._check = None
        transport = self._transport
        if transport is None or transport.is_closing():
            return
        state = connection_state(transport.get_extra_info("socket"))
        if state.is_silent:
            logger.debug("%s no longer answers", self._who())
            transport.abort()
        elif state.is_under_way or self._paused:
            self._check = self._loop.call_later(_CHECK_EVERY_S, self._check_peer)

    def _is_paused(self) -> bool:
        return self._paused

    # -- the connection ------------------------------------------------------------------------

    async def _keep_linked(self) -> None:
        if not self._ways:
            logger.warning("no transport of this node reaches %s", self._who())
        while not self._closed:
            if await self._dial():
                await self._lost.wait()
                logger.debug("link to %s broke", self._who())
                self._on_broken(self)
            if not self._closed:
                await asyncio.sleep(self._backoff.next_delay())

    async def _dial(self) -> bool:
        self._lost.clear()
        for way in self._ways:
            self._way = way
            try:
                async with asyncio.timeout(_DIAL_TIMEOUT_S):
                    await way.transport.dial(way.address, self)
                return True
            except (OSError, ValueError) as error:
                # ValueError: what a peer registered is no address at all.
                logger.debug("%s does not answer: %s", self._who(), error)
        self._on_broken(self)
        return False

    def _who(self) -> str:
        return f"{self.target.node or 'node'} at {join_address(*self.target.key)}"

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        # uvloop's transports are none of asyncio's by class.
        self._transport = cast("asyncio.Transport", transport)
        self._write = self._transport.write
        # High water at zero: the transport tells at once when a send did not fit the socket.
        self._transport.set_write_buffer_limits(high=0)
        keep_alive(transport.get_extra_info("socket"))
        self._max_write = self._way.transport.max_write_bytes if self._way is not None else None
        self._paused = False
        self.connects += 1
        self._backoff.reset()
        self._on_up(self)
        self._drain()

    def data_received(self, data: bytes) -> None:
        """Data flows one way only; what a peer writes back has no meaning."""

    def pause_writing(self) -> None:
        self._paused = True
        self._direct = False
        self._idle.clear()
        self._on_room()

    def resume_writing(self) -> None:
        self._paused = False
        self.turns += 1
        self._drain()

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002
        self._transport = None
        self._write = _nowhere
        self._direct = False
        self._paused = False
        self.turns += 1
        if not self._keeps_over_breaks:
            self.queue.clear()
        if not self.queue:
            self._idle.set()
        if self._check is not None:
            self._check.cancel()
            self._check = None
        self._lost.set()
        self._on_room()

    # -- the end -------------------------------------------------------------------------------

    async def flush(self) -> None:
        """Wait until everything queued has been handed to the kernel."""
        if not self._closed:
            await self._idle.wait()

    def close(self) -> None:
        """End the link; what still waits is given up."""
        if self._closed:
            return
        self._closed = True
        self._direct = False
        self.queue.clear()
        self._task.cancel()
        self._idle.set()
        if self._transport is not None:
            # A reader that never reads on must not keep what it was lent.
            self.keep_own()
            self.turns += 1
            self._transport.close()
        self._lost.set()
        self._on_room()


def _nowhere(data: bytes) -> None:
    raise AssertionError(f"{len(data)} bytes were written to a link that is down")
