"""A link inside one process: from a publisher to a subscriber on the same event loop."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Sequence
from typing import Any

from simple_ros.loans import Loan
from simple_ros.net.feeder import Feeder, Source
from simple_ros.qos import MAX_DEPTH, QosProfile
from simple_ros.router import Router
from simple_ros.wire.framing import FrameDecoder, Run
from simple_ros.wire.queues import BoundedQueue
from simple_ros.wire.session import Target

__all__ = ["LocalLink", "ReferenceLink"]


class LocalLink:
    """Carries frames to another node's router at the end of the loop tick, without the network.

    The subscriber gets messages of its own, so that a publisher may reuse its object.

    Attributes:
        target: Who is at the other end.
        queue: What waits, with its drop counters.
        sent: Messages delivered.
    """

    def __init__(
        self,
        target: Target,
        profile: QosProfile,
        router: Router,
        *,
        on_room: Callable[[], None],
        on_broken: Callable[[LocalLink], None],
    ) -> None:
        self.target = target
        self.queue: BoundedQueue[Any] = BoundedQueue(profile.depth, profile.max_bytes)
        self.sent = 0
        self._router = router
        self._profile = profile
        self._on_room = on_room
        self._on_broken = on_broken
        self._loop = asyncio.get_running_loop()
        self._decoder = FrameDecoder(max_message_bytes=2**32)
        self._feeder = Feeder(self, router, lambda: None, self._go_on)
        self._scheduled = False
        self._closed = False
        self._empty = asyncio.Event()
        self._empty.set()
        router.local_links[self] = self._peer_ended

    @property
    def is_up(self) -> bool:
        """Whether the other end is there."""
        return not self._closed

    def _peer_ended(self) -> None:
        self.close()
        self._on_broken(self)

    def send(
        self,
        frames: Sequence[bytes],
        joined: bytes,  # noqa: ARG002
        expires_at: float = math.inf,
    ) -> None:
        """Queue frames for the end of the tick.

        As over a network, ``depth`` only counts once the subscriber holds things up.
        """
        if self._closed:
            return
        self.queue.depth = self._profile.depth if self._feeder.is_stalled else MAX_DEPTH
        for frame in frames:
            self.queue.push(frame, len(frame), expires_at)
        self._schedule()

    def _schedule(self) -> None:
        self._empty.clear()
        if not self._scheduled:
            self._scheduled = True
            self._loop.call_soon(self._deliver)

    def send_parts(
        self,
        parts: tuple[Any, ...],
        expires_at: float = math.inf,
        loan: Loan | None = None,  # noqa: ARG002
    ) -> None:
        """Queue one large frame, given as several buffers; they are copied."""
        joined = b"".join(parts)
        self.send((joined,), joined, expires_at)

    is_busy = False
    """Whether a message should rather wait than be queued: it never goes by a socket."""

    write_lone = None
    """What sends a frame that comes alone: nothing is sent at once."""

    takes_any = False
    """Whether everything is taken for now: it depends on the queue."""

    def has_room(self, size: int, count: int = 1) -> bool:
        """Whether ``count`` messages of ``size`` bytes in all can be queued, with none given up."""
        waiting = len(self.queue) + count <= self._profile.depth
        return waiting and self.queue.has_room(size, count)

    def _deliver(self) -> None:
        self._scheduled = False
        if self._closed or self._feeder.is_stalled:
            return
        frames = self.queue.take(self._loop.time(), self.queue.size_bytes)
        self.sent += len(frames)
        self._feeder.feed(self._runs(frames))
        if not self._feeder.is_stalled:
            self._go_on()

    def _runs(self, items: list[Any]) -> list[Run]:
        return self._decoder.feed(b"".join(items))

    def _go_on(self) -> None:
        if self.queue and not self._scheduled:
            self._scheduled = True
            self._loop.call_soon(self._deliver)
        elif not self.queue and not self._feeder.is_stalled:
            self._empty.set()
        self._on_room()

    def expect_life_within(self, seconds: float) -> None:
        """Both ends live in one process."""

    async def flush(self) -> None:
        """Wait until everything queued is delivered."""
        await self._empty.wait()

    def close(self) -> None:
        """End the link; what still waits is given up."""
        if not self._closed:
            self._closed = True
            self._router.local_links.pop(self, None)
            self.queue.clear()
            self.queue.dropped += self._feeder.close()
            self._empty.set()
            self._router.link_ended(self)
            self._on_room()


class ReferenceLink(LocalLink):
    """The same without serialising: the other node's subscribers get the very object.

    Args:
        header: What a frame of these messages would begin with.
        parse: What a subscription of the same class would parse with.
        encode: Makes bytes for subscriptions that want something else.
    """

    def __init__(
        self,
        target: Target,
        profile: QosProfile,
        router: Router,
        header: bytes,
        parse: Callable[[Any], Any],
        encode: Callable[[Any], bytes],
        *,
        on_room: Callable[[], None],
        on_broken: Callable[[LocalLink], None],
    ) -> None:
        super().__init__(target, profile, router, on_room=on_room, on_broken=on_broken)
        self._header = header
        self._parse = parse
        self._encode = encode
        self._feeder = Feeder(self, self, lambda: None, self._go_on)

    def send_object(self, message: Any, expires_at: float = math.inf) -> None:
        """Queue a message for the end of the tick."""
        if not self._closed:
            self.queue.depth = self._profile.depth if self._feeder.is_stalled else MAX_DEPTH
            self.queue.push(message, 1, expires_at)
            self._schedule()

    def send(
        self,
        frames: Sequence[bytes],
        joined: bytes,  # noqa: ARG002
        expires_at: float = math.inf,
    ) -> None:
        """Queue frames (a latched message): made objects of here."""
        skip = len(self._header) + 4
        for frame in frames:
            self.send_object(self._parse(memoryview(frame)[skip:]), expires_at)

    def _runs(self, items: list[Any]) -> list[Run]:
        return [Run(self._header, items)] if items else []

    def receive(self, link: Source, run: Run, resume: Callable[[], None], *, force: bool) -> int:
        """Hand objects to the other node's router; see `Receiver.receive`."""
        return self._router.receive_objects(
            link, run, self._parse, self._encode, resume, force=force
        )

    def link_refused(self, peer: str, reason: str) -> None:
        """There is no stream that could be refused."""

    def link_ended(self, link: Source) -> None:
        """`close` tells the router."""
