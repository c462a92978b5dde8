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

from simple_ros.net.addresses import connection_state, join_address, keep_alive, split_address
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
    """

    def __init__(
        self,
        target: Target,
        profile: QosProfile,
        *,
        on_up: Callable[[OutboundLink], None],
        on_broken: Callable[[OutboundLink], None],
        on_room: Callable[[], None],
    ) -> None:
        self.target = target
        self.queue: BoundedQueue[bytes] = BoundedQueue(profile.depth, profile.max_bytes)
        self.connects = 0
        self.sent = 0
        self._keeps_over_breaks = profile.reliability is Reliability.RELIABLE
        self._on_up = on_up
        self._on_broken = on_broken
        self._on_room = on_room
        self._loop = asyncio.get_running_loop()
        self._transport: asyncio.Transport | None = None
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
            self._transport.write(joined)
            if self._check is None:
                self._check = self._loop.call_later(_CHECK_EVERY_S, self._check_peer)
            return
        if self._closed:
            return
        self._idle.clear()
        for frame in frames:
            self.queue.push(frame, len(frame), expires_at)

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
                transport.write(b"".join(frames))
            if not self._is_paused():
                self._direct = True
                self._idle.set()
            if self._check is None:
                self._check = self._loop.call_later(_CHECK_EVERY_S, self._check_peer)
        self._on_room()

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
        while not self._closed:
            if await self._dial():
                await self._lost.wait()
                logger.debug("link to %s broke", self._who())
                self._on_broken(self)
            if not self._closed:
                await asyncio.sleep(self._backoff.next_delay())

    async def _dial(self) -> bool:
        self._lost.clear()
        addresses = [join_address(*self.target.key), *self.target.addresses]
        for address in addresses:
            try:
                host, port = split_address(address)
                async with asyncio.timeout(_DIAL_TIMEOUT_S):
                    await self._loop.create_connection(lambda: self, host, port)
                return True
            except (OSError, OverflowError, ValueError) as error:
                # ValueError: what a peer registered is no address at all.
                logger.debug("%s does not answer: %s", self._who(), error)
        self._on_broken(self)
        return False

    def _who(self) -> str:
        return f"{self.target.node or 'node'} at {join_address(*self.target.key)}"

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        # High water at zero: the transport tells at once when a send did not fit the socket.
        transport.set_write_buffer_limits(high=0)
        keep_alive(transport.get_extra_info("socket"))
        self._transport = transport
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

    def resume_writing(self) -> None:
        self._paused = False
        self._drain()

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002
        self._transport = None
        self._direct = False
        self._paused = False
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
            self._transport.close()
        self._lost.set()
        self._on_room()
