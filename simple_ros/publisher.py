"""Publishers.

A message is serialised once, whatever the number of subscribers. A message that comes alone is sent
at once. Those that follow it within 0.1 ms are a burst: they are joined and sent together when the
present tick of the event loop ends, or earlier, when 128 of them (256, for several links; fewer while a link that
must not lose any is busy) or one of more than 1 KiB have gathered. So a single
message is never delayed, a burst costs one system call, and a slow publisher costs no extra tick.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from struct import Struct
from typing import TYPE_CHECKING, Any, Generic, Self, TypeVar

from simple_ros.codecs import Codec
from simple_ros.errors import HandleClosed, MessageTooLarge, QueueFull
from simple_ros.events import DeadlineMissed, IncompatibleQos, QosEvent, QosEventCallback
from simple_ros.links import Link, Spelling, SubscriberLinks
from simple_ros.loans import Loan
from simple_ros.names import MAX_NAME_BYTES
from simple_ros.net.memory import LARGE_BYTES, keep_large_blocks
from simple_ros.net.transport import InProcess, Transport
from simple_ros.qos import Durability, QosProfile
from simple_ros.watch import Watchdog
from simple_ros.wire.framing import MAX_DATA_BYTES
from simple_ros.wire.session import Target

if TYPE_CHECKING:
    from simple_ros.node import NodeHandle
    from simple_ros.router import Router

__all__ = ["Publisher", "PublisherStatistics"]

logger = logging.getLogger(__name__)

MessageT = TypeVar("MessageT")

_pack_u32 = Struct(">I").pack
_monotonic = time.monotonic
_get_ident = threading.get_ident
_BATCH_MESSAGES = 128
_BATCH_WHILE_BUSY = 64
_SMALL_BYTES = 1024
_MOST_TOGETHER = 256
_FRAME_BYTES = _SMALL_BYTES + 4 + 2 * (2 + MAX_NAME_BYTES)
_LARGE_BYTES = 64 * 1024
_BURST_S = 100e-6


@dataclass(frozen=True, slots=True)
class PublisherStatistics:
    """Counters since the publisher was made.

    Attributes:
        published: Calls of publish.
        sent: Messages handed to links; one message to three subscribers counts three.
        dropped: Messages given up because a subscriber could not keep up, or its link broke.
        expired: Messages given up because their lifespan had passed.
        waiting: Messages that wait now.
    """

    published: int
    sent: int
    dropped: int
    expired: int
    waiting: int


class Publisher(Generic[MessageT]):
    """Sends messages of one type on one topic. Made by `NodeHandle.advertise`.

    Attributes:
        topic: Canonical topic name.
        msg_type: Full protobuf name.
        qos: What is offered.
        message_class: Class of its messages.
        encode: Makes bytes of a message.
    """

    def __init__(
        self,
        node: NodeHandle,
        topic: str,
        message_class: type[MessageT],
        codec: Codec,
        qos: QosProfile,
        on_event: QosEventCallback | None,
        transports: Sequence[Transport | InProcess],
    ) -> None:
        self.topic = topic
        self.msg_type = codec.type_name(message_class)
        self.qos = qos
        self.message_class = message_class
        self.encode = codec.encoder(message_class)
        self._part = codec.parter(message_class)
        self._codec = codec
        self._node = node
        self._on_event = on_event
        self._loop = asyncio.get_running_loop()
        self._thread = threading.get_ident()
        self._links = SubscriberLinks(
            topic,
            self.msg_type,
            codec,
            message_class,
            qos,
            transports,
            local_router=self._local_router,
            before_change=self._send_batch,
            on_up=self._link_up,
            on_change=self._has_changed,
            on_incompatible=self._report_incompatible,
        )
        self._latches = qos.durability is Durability.TRANSIENT_LOCAL
        self._latched: tuple[bytes, float] | None = None
        self._lifespan = math.inf if qos.lifespan_s is None else qos.lifespan_s
        self._blocks = qos.overflow == "block"
        self._ticking = False
        self._sent_at = 0.0
        self._is_plain = False
        self._is_direct = True
        self._write_lone: Callable[[bytes], object] | None = None
        self._together = _BATCH_MESSAGES
        self._bursts = False
        self._size = -1
        self._prefix = b""
        self._batch: list[bytes] = []
        self._closed = False
        self._changed = asyncio.Event()
        self._room = asyncio.Event()
        self._published = 0
        self._deadline: Watchdog | None = None
        if qos.deadline_s is not None:
            self._deadline = Watchdog(qos.deadline_s, self._deadline_missed)

    # -- publishing ----------------------------------------------------------------------------

    def publish(self, message: MessageT) -> None:
        """Send to every subscriber; never waits.

        Raises:
            TypeError: The message is of another type than the topic.
            ValueError: A codec cannot write the message.
            QueueFull: With ``overflow="block"``, a subscriber has no room; nothing was sent.
            HandleClosed: The publisher or its node is closed.
            NodeNameTaken: A newer node runs under this node's name.
        """
        if message.__class__ is not self.message_class:
            self.check_type(message)
        if self._is_plain and _get_ident() == self._thread:
            # The same as below, without asking what cannot be the case: half the cost.
            payload = self.encode(message)
            size = len(payload)
            if size <= _SMALL_BYTES:
                frame = (self._prefix if size == self._size else self._prefixed(size)) + payload
                if not self._ticking and _monotonic() - self._sent_at > _BURST_S:
                    self._published += 1
                    if self._write_lone is not None:
                        self._write_lone(frame)
                        self._sent_at = _monotonic()
                    else:
                        self._send_alone(self._links.spellings[0], frame)
                    return
                batch = self._batch
                batch.append(frame)
                if not self._ticking:
                    self._begin_tick()
                elif len(batch) >= self._together:
                    self._send_batch()
                return
            self.publish_bytes(payload)
        elif self._links.references:
            self._publish_object(message)
        elif self._part is not None:
            self._publish_parts(self._part(message))
        else:
            self.publish_bytes(self.encode(message))

    def publish_bytes(self, payload: bytes) -> None:
        """Send a message that is serialised already. Raises as `publish`."""
        self.check_open()
        if self._links.references:
            self._publish_object(self._codec.decoder(self.message_class)(payload), payload)
            return
        size = self._checked_size(payload)
        if self._blocks and not self._has_room(size):
            raise QueueFull(self.topic)
        self._put(payload, size)

    def _publish_object(self, message: Any, payload: bytes | None = None) -> None:
        """As `publish_bytes`, with subscribers that take the object itself."""
        self.check_open()
        self._check_thread()
        wants_bytes = bool(self._links.spellings) or self._latches
        if wants_bytes and payload is None:
            payload = self.encode(message)
        size = 0 if payload is None else self._checked_size(payload)
        if self._blocks and not self._has_room(size):
            raise QueueFull(self.topic)
        expires_at = self._expiry()
        for link in self._links.references:
            link.send_object(message, expires_at)
        self._put(b"" if payload is None else payload, size)

    async def publish_async(self, message: MessageT) -> None:
        """Send, waiting until every subscriber has room (with ``overflow="block"``).

        Then a large array, as the pixels of an image, is sent from where it is and is free when this returns.
        If this is cancelled while it waits, the rest of the array is copied and sent all the same.

        Raises:
            TypeError: The message is of another type than the topic.
            HandleClosed: The publisher or its node is closed.
            NodeNameTaken: A newer node runs under this node's name.
        """
        if message.__class__ is not self.message_class:
            self.check_type(message)
        if self._bursts:
            payload = self.encode(message)
            size = len(payload)
            if size <= _SMALL_BYTES:
                batch = self._batch
                batch.append(
                    (self._prefix if size == self._size else self._prefixed(size)) + payload
                )
                if len(batch) >= self._together:
                    self._send_batch()
                    # Give everybody else a turn.
                    await asyncio.sleep(0)
                return
            await self.publish_bytes_async(payload)
        elif self._links.references:
            await self._wait_for_room(1)
            self._publish_object(message)
        elif self._part is not None:
            await self._publish_parts_async(self._part(message))
        else:
            await self.publish_bytes_async(self.encode(message))

    def publish_batch(self, payloads: Sequence[bytes]) -> bool:
        """Send small messages that are serialised already, all at once; False if that cannot be done.

        For who has gathered them elsewhere (the blocking face); then they go one by one.

        Raises:
            HandleClosed: The publisher or its node is closed.
            NodeNameTaken: A newer node runs under this node's name.
        """
        self.check_open()
        if not self._is_plain or max(map(len, payloads)) > _SMALL_BYTES:
            return False
        self._check_thread()
        self._send_batch()
        spelling = self._links.spellings[0]
        header, pack = spelling.header, _pack_u32
        frames = [header + pack(len(payload)) + payload for payload in payloads]
        joined = b"".join(frames)
        if self._blocks and not self._links.have_room(len(joined), len(frames)):
            return False
        self._published += len(frames)
        expires_at = self._expiry()
        for link in spelling.links:
            link.send(frames, joined, expires_at)
        if not self._is_direct:
            self._reconsider()
        return True

    async def publish_bytes_async(self, payload: bytes) -> None:
        """Send a message that is serialised already, as `publish_async`."""
        size = self._checked_size(payload)
        if self._closed or (self._blocks and not self._has_room(size)):
            await self._wait_for_room(size)
        if self._links.references:
            self._publish_object(self._codec.decoder(self.message_class)(payload), payload)
            return
        if self._put(payload, size):
            # A batch has just gone out, or nobody is there: give everybody else a turn.
            await asyncio.sleep(0)

    async def _wait_for_change(self) -> None:
        self._room.clear()
        await self._room.wait()

    async def _wait_for_room(self, size: int) -> None:
        while self._blocks and not self._closed and not self._has_room(size):
            await self._wait_for_change()
        if self._closed:
            self.check_open()

    def check_open(self) -> None:
        """Raise `HandleClosed` or `NodeNameTaken` if nothing can be published any more."""
        if self._closed:
            raise self._node.failure or HandleClosed(f"publisher of {self.topic!r}")

    def _checked_size(self, payload: bytes) -> int:
        size = len(payload)
        if size > MAX_DATA_BYTES:
            raise MessageTooLarge(self.topic, size, MAX_DATA_BYTES)
        return size

    def _put(self, payload: bytes, size: int) -> bool:
        """Send now or with the batch of this tick; True if it is somebody else's turn."""
        if _get_ident() != self._thread:
            self._check_thread()
        if self._latches:
            self._latched = payload, self._expiry()
        if self._deadline is not None:
            self._deadline.happened()
        if not self._links.spellings:
            self._published += 1
            # Who sends without end would otherwise never see a subscriber come.
            return True
        if size >= _LARGE_BYTES:
            self._send_large((payload,), size)
            return True
        if not self._ticking:
            if _monotonic() - self._sent_at > _BURST_S:
                self._published += 1
                self._send_now(payload)
                return False
            self._begin_tick()
        for spelling in self._links.spellings:
            spelling.batch.append(spelling.header + _pack_u32(size) + payload)
        waiting = self._links.spellings[0].batch
        if len(waiting) >= self._together or size > _SMALL_BYTES:
            self._send_batch()
            return True
        return False

    async def _publish_parts_async(self, parts: tuple[Any, ...]) -> None:
        """As `publish_async`, for a message that is several buffers."""
        size = sum(map(len, parts))
        if not self._blocks or size < _LARGE_BYTES or self._latches or self._links.references:
            await self._wait_for_room(size)
            self._publish_parts(parts)
            return
        while self._links.are_busy and not self._closed:
            # In a queue it would have to be copied.
            await self._wait_for_change()
        await self._wait_for_room(size)
        with Loan() as loan:
            self._publish_parts(parts, loan)
            await asyncio.sleep(0)
            while loan.is_open and not self._closed:
                await self._wait_for_change()

    def _publish_parts(self, parts: tuple[Any, ...], loan: Loan | None = None) -> None:
        """As `publish_bytes`, for a message that is several buffers; copied only as far as they have to wait."""
        self.check_open()
        size = sum(map(len, parts))
        if size < _LARGE_BYTES or self._latches:
            self.publish_bytes(b"".join(parts))
            return
        if size > MAX_DATA_BYTES:
            raise MessageTooLarge(self.topic, size, MAX_DATA_BYTES)
        if self._blocks and not self._has_room(size):
            raise QueueFull(self.topic)
        self._check_thread()
        if self._deadline is not None:
            self._deadline.happened()
        self._send_large(parts, size, loan)

    def _send_large(self, parts: tuple[Any, ...], size: int, loan: Loan | None = None) -> None:
        """Send at once, after what waits in this tick's batch."""
        if size >= LARGE_BYTES:
            keep_large_blocks()
        self._send_batch()
        self._published += 1
        expires_at = self._expiry()
        for spelling in self._links.spellings:
            frame = (spelling.header + _pack_u32(size), *parts)
            for link in spelling.links:
                link.send_parts(frame, expires_at, loan)
        if not self._is_direct:
            self._reconsider()

    def _check_thread(self) -> None:
        if _get_ident() != self._thread:
            raise RuntimeError(
                f"publish on {self.topic!r} was called from another thread than its event loop's"
            )

    def _send_now(self, payload: bytes) -> None:
        for spelling in self._links.spellings:
            self._send_alone(spelling, spelling.header + _pack_u32(len(payload)) + payload)

    def _send_alone(self, spelling: Spelling, frame: bytes) -> None:
        expires_at = self._expiry()
        frames = (frame,)
        for link in spelling.links:
            link.send(frames, frame, expires_at)
        # Afterwards: to many links, sending alone takes longer than a burst may pause.
        self._sent_at = _monotonic()
        if not self._is_direct:
            self._reconsider()

    def _begin_tick(self) -> None:
        self._ticking = True
        self._bursts = self._is_plain
        self._loop.call_soon(self._end_tick)

    def _end_tick(self) -> None:
        self._ticking = self._bursts = False
        self._send_batch()

    def _send_batch(self) -> None:
        spellings = self._links.spellings
        if not spellings or not spellings[0].batch:
            return
        self._published += len(spellings[0].batch)
        expires_at = self._expiry()
        for spelling in spellings:
            frames = tuple(spelling.batch)
            spelling.batch.clear()
            joined = b"".join(frames)
            for link in spelling.links:
                link.send(frames, joined, expires_at)
        self._sent_at = _monotonic()
        if not self._is_direct:
            self._reconsider()

    def _expiry(self) -> float:
        return self._lifespan if self._lifespan == math.inf else self._loop.time() + self._lifespan

    def _has_room(self, size: int) -> bool:
        """Whether every link can take one more message, after what waits in this tick's batch."""
        batch = self._links.spellings[0].batch if self._links.spellings else ()
        if self._links.have_room(size + sum(map(len, batch)), len(batch) + 1):
            return True
        if not batch:
            return False
        self._send_batch()
        return self._links.have_room(size)

    def check_type(self, message: Any) -> None:
        """Raise TypeError if a message is of another type than the topic."""
        given: Any = type(message)
        if isinstance(message, self.message_class):
            return
        if self._codec.handles(given) and self._codec.type_name(given) == self.msg_type:
            return
        name = getattr(getattr(message, "DESCRIPTOR", None), "full_name", given.__name__)
        raise TypeError(f"topic {self.topic!r} carries {self.msg_type}, not {name}")

    # -- subscribers ---------------------------------------------------------------------------

    @property
    def subscriber_count(self) -> int:
        """Subscribers that are linked now."""
        return self._links.up_count

    async def wait_for_subscribers(self, count: int = 1, timeout: float | None = None) -> None:
        """Wait until at least ``count`` subscribers are linked.

        Raises:
            TimeoutError: Not within ``timeout`` seconds.
            HandleClosed: The publisher was closed meanwhile.
        """
        async with asyncio.timeout(timeout):
            while self.subscriber_count < count:
                self.check_open()
                self._changed.clear()
                await self._changed.wait()

    @property
    def statistics(self) -> PublisherStatistics:
        """Counters so far."""
        total = self._links.totals
        return PublisherStatistics(
            self._published + self._batched, total.sent, total.dropped, total.expired, total.waiting
        )

    @property
    def _batched(self) -> int:
        """Messages that wait for the end of this tick."""
        return len(self._links.spellings[0].batch) if self._links.spellings else 0

    @property
    def targets(self) -> tuple[Target, ...]:
        """The subscribers the Master has named."""
        return self._links.targets

    def targets_update(
        self, add: Iterable[Target], remove: Iterable[Target] = (), *, snapshot: bool = False
    ) -> None:
        """Take an update of the Master (called by the node)."""
        if not self._closed:
            self._links.update(add, remove, snapshot=snapshot)

    def reregistered(self) -> None:
        """A Master that knew nothing was told about this publisher (called by the node)."""
        self._links.reregistered()

    def master_lost(self) -> None:
        """The Master is gone: who it did not name stays, until the next one (called by the node)."""
        self._links.master_lost()

    def _local_router(self, instance_id: str) -> Router | None:
        node = self._node.local_peer(instance_id)
        return None if node is None else node.router

    def _link_up(self, link: Link) -> None:
        if not link.queue:
            self._send_latched(link)
        self._has_changed()

    def _send_latched(self, link: Link) -> None:
        if self._latched is None:
            return
        payload, expires_at = self._latched
        if expires_at > self._loop.time():
            frame = self._links.header_of(link.target) + _pack_u32(len(payload)) + payload
            link.send((frame,), frame, expires_at)

    def _reconsider(self) -> None:
        """Whether the next message of a burst needs nothing but to be appended to the batch."""
        spellings = self._links.spellings
        links = sum(len(spelling.links) for spelling in spellings)
        # A system call for each link is what a batch costs: the more links, the more messages share it.
        self._is_direct = not self._blocks or all(
            link.takes_any for spelling in spellings for link in spelling.links
        )
        batch = _BATCH_MESSAGES if self._is_direct else _BATCH_WHILE_BUSY
        together = min(batch * max(1, links), _MOST_TOGETHER)
        if self._blocks:
            # A link that breaks now keeps them for its successor.
            together = max(_BATCH_WHILE_BUSY, min(together, self.qos.depth))
        self._together = together
        self._is_plain = (
            len(spellings) == 1
            and not (self._closed or self._latches or self._deadline or self._links.references)
            and self._part is None
            and (self._is_direct or self._links.have_room(together * _FRAME_BYTES, together))
        )
        self._size = -1
        self._bursts = self._is_plain and self._ticking
        self._write_lone = None
        if self._is_plain:
            self._batch = spellings[0].batch
            if links == 1 and self._lifespan == math.inf:
                self._write_lone = spellings[0].links[0].write_lone

    def _prefixed(self, size: int) -> bytes:
        """What stands before a message of so many bytes; kept, since the next often has as many."""
        self._size = size
        self._prefix = self._links.spellings[0].header + _pack_u32(size)
        return self._prefix

    def _has_changed(self) -> None:
        self._reconsider()
        self._changed.set()
        self._room.set()

    # -- events --------------------------------------------------------------------------------

    def _report_incompatible(self, target: Target, policies: list[str]) -> None:
        logger.warning(
            "IncompatibleQos: %r on %r is not sent to node %r, which requests more: %s",
            self.msg_type,
            self.topic,
            target.node,
            ", ".join(policies),
        )
        self.report(IncompatibleQos(self.topic, self._node.name, target.node, tuple(policies)))

    def _deadline_missed(self, total: int) -> None:
        assert self.qos.deadline_s is not None
        self.report(DeadlineMissed(self.topic, self.qos.deadline_s, total))

    def report(self, event: QosEvent) -> None:
        """Hand an event to the user's callback (called by the node)."""
        if self._on_event is not None:
            self._node.guard.call(self._on_event, event)

    # -- the end -------------------------------------------------------------------------------

    async def flush(self, timeout: float | None = None) -> None:
        """Wait until everything published has been handed to the operating system.

        Raises:
            TimeoutError: Not within ``timeout`` seconds.
        """
        self._send_batch()
        async with asyncio.timeout(timeout):
            await self._links.flush()

    async def close(self) -> None:
        """Stop publishing: unregister, send what still waits (up to 0.5 s), end the links."""
        if not self._closed:
            with contextlib.suppress(TimeoutError):
                await self.flush(self._node.flush_allowance())
            self.abandon()
            await self._node.forget_publisher(self)

    unregister = close

    def abandon(self) -> None:
        """End at once, telling nobody (called by the node)."""
        if self._closed:
            return
        self._closed = True
        if self._deadline is not None:
            self._deadline.stop()
        self._links.close()
        self._has_changed()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    def __repr__(self) -> str:
        state = "closed" if self._closed else f"{self.subscriber_count} linked"
        return f"<Publisher {self.topic} [{self.msg_type}] {state}>"
