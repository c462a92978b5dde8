"""Publishers.

A message is serialised once, whatever the number of subscribers. A message that comes alone is sent
at once. Those that follow it within 0.1 ms are a burst: they are joined and sent together when the
present tick of the event loop ends, or earlier, when 64 of them or 64 KiB have gathered. So a single
message is never delayed, a burst costs one system call, and a slow publisher costs no extra tick.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import threading
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from struct import Struct
from typing import TYPE_CHECKING, Any, Generic, Self, TypeVar

from google.protobuf.message import Message

from simple_ros.errors import FrameError, HandleClosed, MessageTooLarge, QueueFull
from simple_ros.events import DeadlineMissed, IncompatibleQos, QosEvent, QosEventCallback
from simple_ros.local import LocalLink
from simple_ros.net.peer import OutboundLink
from simple_ros.qos import Durability, QosProfile, incompatibilities
from simple_ros.watch import Watchdog
from simple_ros.wire.framing import MAX_DATA_BYTES, encode_header
from simple_ros.wire.session import Target, TargetChanges, TargetSet

if TYPE_CHECKING:
    from simple_ros.node import NodeHandle

__all__ = ["Publisher", "PublisherStatistics"]

logger = logging.getLogger(__name__)

MessageT = TypeVar("MessageT", bound=Message)
Link = OutboundLink | LocalLink

_pack_u32 = Struct(">I").pack
_monotonic = time.monotonic
_get_ident = threading.get_ident
_BATCH_MESSAGES = 64
_BATCH_BYTES = 64 * 1024
_BURST_S = 100e-6
_UNCONFIRMED_S = 10.0


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


@dataclass(slots=True)
class _Spelling:
    """The links whose peers spell the topic alike: they share bytes."""

    header: bytes
    links: list[Link] = field(default_factory=list)
    batch: list[bytes] = field(default_factory=list)


class Publisher(Generic[MessageT]):
    """Sends messages of one type on one topic. Made by `NodeHandle.advertise`.

    Attributes:
        topic: Canonical topic name.
        msg_type: Full protobuf name.
        qos: What is offered.
        message_class: Class of its messages.
    """

    def __init__(
        self,
        node: NodeHandle,
        topic: str,
        message_class: type[MessageT],
        qos: QosProfile,
        on_event: QosEventCallback | None,
    ) -> None:
        self.topic = topic
        self.msg_type: str = message_class.DESCRIPTOR.full_name
        self.qos = qos
        self.message_class = message_class
        self._node = node
        self._on_event = on_event
        self._loop = asyncio.get_running_loop()
        self._thread = threading.get_ident()
        self._targets = TargetSet()
        self._links: dict[tuple[str, int], Link] = {}
        self._spellings: list[_Spelling] = []
        self._incompatible: set[tuple[str, int]] = set()
        self._latches = qos.durability is Durability.TRANSIENT_LOCAL
        self._latched: tuple[bytes, float] | None = None
        self._lifespan = math.inf if qos.lifespan_s is None else qos.lifespan_s
        self._blocks = qos.overflow == "block"
        self._ticking = False
        self._sent_at = 0.0
        self._batched = 0
        self._batched_bytes = 0
        self._closed = False
        self._changed = asyncio.Event()
        self._room = asyncio.Event()
        self._published = 0
        self._gone = PublisherStatistics(0, 0, 0, 0, 0)
        self._confirm_timer: asyncio.TimerHandle | None = None
        self._deadline: Watchdog | None = None
        if qos.deadline_s is not None:
            self._deadline = Watchdog(qos.deadline_s, self._deadline_missed)

    # -- publishing ----------------------------------------------------------------------------

    def publish(self, message: MessageT) -> None:
        """Send to every subscriber; never waits.

        Raises:
            TypeError: The message is of another type than the topic.
            QueueFull: With ``overflow="block"``, a subscriber has no room; nothing was sent.
            HandleClosed: The publisher or its node is closed.
            NodeNameTaken: A newer node runs under this node's name.
        """
        if message.__class__ is not self.message_class:
            self.check_type(message)
        self.publish_bytes(message.SerializeToString())

    def publish_bytes(self, payload: bytes) -> None:
        """Send a message that is serialised already. Raises as `publish`."""
        self.check_open()
        size = self._checked_size(payload)
        if self._blocks and not self._has_room(size):
            raise QueueFull(self.topic)
        self._put(payload, size)

    async def publish_async(self, message: MessageT) -> None:
        """Send, waiting until every subscriber has room (with ``overflow="block"``).

        Raises:
            TypeError: The message is of another type than the topic.
            HandleClosed: The publisher or its node is closed.
            NodeNameTaken: A newer node runs under this node's name.
        """
        if message.__class__ is not self.message_class:
            self.check_type(message)
        await self.publish_bytes_async(message.SerializeToString())

    async def publish_bytes_async(self, payload: bytes) -> None:
        """Send a message that is serialised already, as `publish_async`."""
        size = self._checked_size(payload)
        while self._blocks and not self._closed and not self._has_room(size):
            self._room.clear()
            await self._room.wait()
        if self._closed:
            self.check_open()
        if self._put(payload, size):
            # A batch has just gone out: give everybody else a turn.
            await asyncio.sleep(0)

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
        """Send now or with the batch of this tick; True if that completed a batch."""
        if _get_ident() != self._thread:
            raise RuntimeError(
                f"publish on {self.topic!r} was called from another thread than its event loop's"
            )
        self._published += 1
        if self._latches:
            self._latched = payload, self._expiry()
        if self._deadline is not None:
            self._deadline.happened()
        if not self._spellings:
            return False
        if not self._ticking:
            now = _monotonic()
            if now - self._sent_at > _BURST_S:
                self._sent_at = now
                self._send_now(payload)
                return False
            self._ticking = True
            self._loop.call_soon(self._end_tick)
        for spelling in self._spellings:
            spelling.batch.append(spelling.header + _pack_u32(size) + payload)
        self._batched += 1
        self._batched_bytes += size
        if self._batched >= _BATCH_MESSAGES or self._batched_bytes >= _BATCH_BYTES:
            self._send_batch()
            return True
        return False

    def _send_now(self, payload: bytes) -> None:
        expires_at = self._expiry()
        for spelling in self._spellings:
            frame = spelling.header + _pack_u32(len(payload)) + payload
            frames = (frame,)
            for link in spelling.links:
                link.send(frames, frame, expires_at)

    def _end_tick(self) -> None:
        self._ticking = False
        if self._batched:
            self._send_batch()

    def _send_batch(self) -> None:
        self._batched = self._batched_bytes = 0
        expires_at = self._expiry()
        for spelling in self._spellings:
            frames = spelling.batch
            if frames:
                spelling.batch = []
                joined = b"".join(frames)
                for link in spelling.links:
                    link.send(frames, joined, expires_at)

    def _expiry(self) -> float:
        return self._lifespan if self._lifespan == math.inf else self._loop.time() + self._lifespan

    def _has_room(self, size: int) -> bool:
        """Whether every link can take one more message, after what waits in this tick's batch."""
        for link in self._links.values():
            if not link.has_room(size + self._batched_bytes, self._batched + 1):
                break
        else:
            return True
        if not self._batched:
            return False
        self._send_batch()
        return all(link.has_room(size) for link in self._links.values())

    def check_type(self, message: Any) -> None:
        """Raise TypeError if a message is of another type than the topic."""
        name = getattr(getattr(message, "DESCRIPTOR", None), "full_name", type(message).__name__)
        if name != self.msg_type:
            raise TypeError(f"topic {self.topic!r} carries {self.msg_type}, not {name}")

    # -- subscribers ---------------------------------------------------------------------------

    @property
    def subscriber_count(self) -> int:
        """Subscribers that are linked now."""
        return sum(link.is_up for link in self._links.values())

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
        links = list(self._links.values())
        gone = self._gone
        return PublisherStatistics(
            self._published,
            gone.sent + sum(link.sent for link in links),
            gone.dropped + sum(link.queue.dropped for link in links),
            gone.expired + sum(link.queue.expired for link in links),
            sum(len(link.queue) for link in links),
        )

    @property
    def targets(self) -> tuple[Target, ...]:
        """The subscribers the Master has named."""
        return self._targets.targets

    def targets_update(
        self, add: Iterable[Target], remove: Iterable[Target] = (), *, snapshot: bool = False
    ) -> None:
        """Take an update of the Master (called by the node)."""
        if not self._closed:
            self._apply(self._targets.apply(add, remove, snapshot=snapshot))

    def reregistered(self) -> None:
        """A Master that knew nothing was told about this publisher (called by the node)."""
        self._targets.reregistered()
        if self._confirm_timer is not None:
            self._confirm_timer.cancel()
        self._confirm_timer = self._loop.call_later(
            _UNCONFIRMED_S, lambda: self._apply(self._targets.drop_unconfirmed())
        )

    def master_lost(self) -> None:
        """The Master is gone: who it did not name stays, until the next one (called by the node)."""
        if self._confirm_timer is not None:
            self._confirm_timer.cancel()

    def _apply(self, changes: TargetChanges) -> None:
        for target in changes.closed:
            self._unlink(target)
        for target in changes.opened:
            self._link(target)
        for target in changes.updated:
            self._relink(target)
        self._changed.set()

    def _relink(self, target: Target) -> None:
        """A subscriber's requests have changed."""
        link = self._links.get(target.key)
        if link is None or (target.qos is not None and incompatibilities(self.qos, target.qos)):
            self._unlink(target)
            self._link(target)
        elif target.qos is not None and target.qos.durability is Durability.TRANSIENT_LOCAL:
            self._send_latched(link)

    def _link(self, target: Target) -> None:
        try:
            header = encode_header(target.topic or self.topic, self.msg_type)
        except FrameError as error:
            logger.warning("node %r cannot be sent %r: %s", target.node, self.topic, error)
            return
        if target.qos is not None:
            problems = incompatibilities(self.qos, target.qos)
            if problems:
                self._report_incompatible(target, [problem.policy for problem in problems])
                return
        node = self._node.local_peer(target.instance_id)
        if node is not None:
            link: Link = LocalLink(
                target,
                self.qos,
                node.router,
                on_room=self._has_changed,
                on_broken=lambda link: self.targets_update((), (link.target,)),
            )
        else:
            link = OutboundLink(
                target,
                self.qos,
                on_up=self._link_up,
                on_broken=self._link_broke,
                on_room=self._has_changed,
            )
        self._links[target.key] = link
        self._send_batch()
        spelling = next((item for item in self._spellings if item.header == header), None)
        if spelling is None:
            spelling = _Spelling(header)
            self._spellings.append(spelling)
        spelling.links.append(link)
        if isinstance(link, LocalLink):
            self._link_up(link)

    def _unlink(self, target: Target) -> None:
        self._incompatible.discard(target.key)
        link = self._links.pop(target.key, None)
        if link is None:
            return
        self._send_batch()
        for spelling in self._spellings:
            if link in spelling.links:
                spelling.links.remove(link)
        self._spellings = [spelling for spelling in self._spellings if spelling.links]
        link.close()
        self._remember(link)

    def _remember(self, link: Link) -> None:
        gone, queue = self._gone, link.queue
        self._gone = PublisherStatistics(
            0, gone.sent + link.sent, gone.dropped + queue.dropped, gone.expired + queue.expired, 0
        )

    def _link_up(self, link: Link) -> None:
        if not link.queue:
            self._send_latched(link)
        self._has_changed()

    def _send_latched(self, link: Link) -> None:
        if self._latched is None:
            return
        payload, expires_at = self._latched
        if expires_at > self._loop.time():
            header = encode_header(link.target.topic or self.topic, self.msg_type)
            frame = header + _pack_u32(len(payload)) + payload
            link.send((frame,), frame, expires_at)

    def _link_broke(self, link: OutboundLink) -> None:
        self._apply(self._targets.link_broke(link.target.key))

    def _has_changed(self) -> None:
        self._changed.set()
        self._room.set()

    # -- events --------------------------------------------------------------------------------

    def _report_incompatible(self, target: Target, policies: list[str]) -> None:
        if target.key in self._incompatible:
            return
        self._incompatible.add(target.key)
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
            await asyncio.gather(*(link.flush() for link in list(self._links.values())))

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
        if self._confirm_timer is not None:
            self._confirm_timer.cancel()
        if self._deadline is not None:
            self._deadline.stop()
        for link in list(self._links.values()):
            self._unlink(link.target)
        self._has_changed()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    def __repr__(self) -> str:
        state = "closed" if self._closed else f"{self.subscriber_count} linked"
        return f"<Publisher {self.topic} [{self.msg_type}] {state}>"
