"""Subscriptions.

Three ways to get messages, all in order and one at a time per subscription:

* a plain callable is called straight from the read of the socket, with nothing queued in between:
  back-pressure is TCP's own;
* a coroutine function is awaited in a task of the subscription, fed by its queue;
* with no callback, ``async for message in subscriber`` takes from its queue.

A queue holds ``qos.depth`` messages and gives up the oldest; with ``overflow="block"`` it gives up
nothing and holds back the publisher instead (and every other subscription to this topic in the same
node, since they share its link).
"""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import AsyncIterator, Callable, Coroutine, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, Self, TypeVar

from google.protobuf.message import DecodeError

from simple_ros.callbacks import CALLBACK_ERRORS, CallbackGuard, is_async, is_being_cancelled
from simple_ros.errors import HandleClosed, NodeNameTaken
from simple_ros.events import DeadlineMissed, LivelinessChanged, QosEvent, QosEventCallback
from simple_ros.qos import Liveliness, QosProfile
from simple_ros.watch import Watchdog
from simple_ros.wire.framing import Payload
from simple_ros.wire.queues import BoundedQueue

if TYPE_CHECKING:
    from simple_ros.node import NodeHandle
    from simple_ros.router import Route

__all__ = ["Callback", "Subscriber", "SubscriberStatistics"]

logger = logging.getLogger(__name__)

MessageT = TypeVar("MessageT")
Callback = Callable[[MessageT], None] | Callable[[MessageT], Coroutine[Any, Any, None]]


@dataclass(frozen=True, slots=True)
class SubscriberStatistics:
    """Counters since the subscription was made.

    Attributes:
        received: Messages that arrived.
        dropped: Messages given up because the queue was full.
        expired: Messages given up because their lifespan had passed in the queue.
        errors: Exceptions of the callback.
        waiting: Messages that wait now.
    """

    received: int
    dropped: int
    expired: int
    errors: int
    waiting: int


class Subscriber(Generic[MessageT]):
    """Receives messages of one type on one topic. Made by `NodeHandle.subscribe`.

    It lives until closed: the node holds it, so a handle that is dropped unsubscribes nothing.

    Attributes:
        topic: Canonical topic name.
        msg_type: Full protobuf name.
        qos: What is requested.
        wants_bytes: Whether messages are delivered as ``bytes``, not parsed.
        takes_batches: Whether the callback is given lists of messages.
    """

    def __init__(
        self,
        node: NodeHandle,
        topic: str,
        msg_type: str,
        callback: Callback[MessageT] | None,
        qos: QosProfile,
        on_event: QosEventCallback | None,
        *,
        wants_bytes: bool,
        takes_batches: bool = False,
        room_elsewhere: Callable[[], int] | None = None,
    ) -> None:
        self.topic = topic
        self.msg_type = msg_type
        self.qos = qos
        self.wants_bytes = wants_bytes
        self.takes_batches = takes_batches
        self.route: Route | None = None
        self._node = node
        self._on_event = on_event
        self._guard = CallbackGuard(f"the subscription to {topic!r}")
        self._loop = asyncio.get_running_loop()
        self._lifespan = math.inf if qos.lifespan_s is None else qos.lifespan_s
        self._queue: BoundedQueue[MessageT] = BoundedQueue(qos.depth, qos.max_bytes)
        self._arrived = asyncio.Event()
        self._received = 0
        self._closed = False
        self._task: asyncio.Task[None] | None = None
        self._callback = callback
        self.take = self._chosen_take(callback)
        self._watchdogs = self._made_watchdogs()
        self._alive = False
        self.is_direct = self.take == self._call_directly and room_elsewhere is None
        self.takes_payloads = self.is_direct and not self._watchdogs
        self._room_elsewhere = room_elsewhere
        self.waits = qos.overflow == "block"
        self._waiting: list[Callable[[], None]] = []
        if self._watchdogs:
            self.take = self._watched(self.take)

    def _chosen_take(self, callback: Callback[MessageT] | None) -> Callable[[MessageT, int], None]:
        if callback is None:
            return self._enqueue
        if is_async(callback):
            self._task = self._loop.create_task(
                self._await_callbacks(callback), name=f"callbacks of {self.topic}"
            )
            return self._enqueue
        return self._call_directly

    # -- delivery ------------------------------------------------------------------------------

    def _call_directly(self, message: MessageT, size: int) -> None:  # noqa: ARG002
        if self._closed:
            return
        self._received += 1
        try:
            self._callback(message)  # type: ignore[misc]
        except CALLBACK_ERRORS as error:
            self._guard.failed(error)

    def take_payloads(
        self,
        payloads: list[Payload],
        parse: Callable[[Any], Any],
        unparsable: Callable[[Payload, DecodeError], None],
    ) -> None:
        """What one read of a link brought, still to be parsed (called by the router, if `takes_payloads`)."""
        callback: Any = self._callback
        received = 0
        for payload in payloads:
            try:
                message = parse(payload)
            except DecodeError as error:
                unparsable(payload, error)
                continue
            if self._closed:
                break
            received += 1
            try:
                callback(message)
            except CALLBACK_ERRORS as error:
                self._guard.failed(error)
        self._received += received

    def lone_taker(
        self, parse: Callable[[Any], Any], unparsable: Callable[[Payload, DecodeError], None]
    ) -> Callable[[bytes], None]:
        """As `take_payloads`, for messages that come alone (called by the router, if `takes_payloads`)."""
        callback: Any = self._callback
        failed = self._guard.failed

        def take(payload: bytes) -> None:
            try:
                message = parse(payload)
            except DecodeError as error:
                unparsable(payload, error)
                return
            if self._closed:
                return
            self._received += 1
            try:
                callback(message)
            except CALLBACK_ERRORS as error:
                failed(error)

        return take

    def take_batch(self, messages: list[Any]) -> None:
        """All that one read of a link brought (called by the router, if `takes_batches`)."""
        if not self._closed:
            self._received += len(messages)
            for watchdog in self._watchdogs:
                watchdog.happened()
            self._guard.call(self._callback, messages)  # type: ignore[arg-type]

    def _enqueue(self, message: MessageT, size: int) -> None:
        if self._closed:
            return
        self._received += 1
        if self._lifespan == math.inf:
            self._queue.push(message, size)
        else:
            self._queue.push(message, size, self._loop.time() + self._lifespan)
        self._arrived.set()

    async def _await_callbacks(self, callback: Callable[[MessageT], Any]) -> None:
        async for message in self:
            try:
                await callback(message)
            except CALLBACK_ERRORS as error:
                if is_being_cancelled():
                    raise
                self._guard.failed(error)

    async def receive(self) -> MessageT:
        """The next message.

        Raises:
            HandleClosed: The subscription is closed.
            NodeNameTaken: A newer node runs under this node's name.
        """
        while True:
            if self._closed:
                raise self._node.failure or HandleClosed(f"subscription to {self.topic!r}")
            if self._queue:
                message = self._queue.pop(self._loop.time())
                if self._waiting:
                    self._wake_waiting()
                if message is not None:
                    return message
            self._arrived.clear()
            await self._arrived.wait()

    async def receive_within(self, timeout: float | None) -> MessageT:
        """The next message.

        Raises:
            TimeoutError: Not within ``timeout`` seconds.
            HandleClosed: The subscription is closed.
        """
        async with asyncio.timeout(timeout):
            return await self.receive()

    def room(self, sizes: Sequence[int]) -> int:
        """How many of the next messages, of so many bytes, fit the queue now (asked by the router)."""
        if self._room_elsewhere is not None:
            return min(len(sizes), max(0, self._room_elsewhere()))
        queue = self._queue
        count = min(self.qos.depth - len(queue), len(sizes))
        space = self.qos.max_bytes - queue.size_bytes
        if sum(sizes) <= space:
            return count
        fitting = 0
        for size in sizes[:count]:
            space -= size
            if space < 0 and (fitting or queue):
                break
            fitting += 1
        return fitting

    def call_when_room(self, resume: Callable[[], None]) -> None:
        """Call once, when there is room again (asked by the router)."""
        self._waiting.append(resume)
        if self._room_elsewhere is not None and self._room_elsewhere() > 0:
            # The other thread made room before it could see that somebody waits.
            self._wake_waiting()

    @property
    def is_waited_for(self) -> bool:
        """Whether a link waits for room. May be asked from another thread."""
        return bool(self._waiting)

    def room_made(self) -> None:
        """There is room elsewhere again."""
        if self._waiting:
            self._wake_waiting()

    def _wake_waiting(self) -> None:
        waiting, self._waiting = self._waiting, []
        for resume in waiting:
            self._loop.call_soon(resume)

    async def __aiter__(self) -> AsyncIterator[MessageT]:
        """Messages until the subscription is closed."""
        try:
            while True:
                yield await self.receive()
        except (HandleClosed, NodeNameTaken):
            return

    # -- what is expected of the publishers ----------------------------------------------------

    def _made_watchdogs(self) -> tuple[Watchdog, ...]:
        qos = self.qos
        found = []
        if qos.deadline_s is not None:
            found.append(Watchdog(qos.deadline_s, self._deadline_missed))
        if qos.liveliness_lease_s is not None and qos.liveliness is Liveliness.MANUAL_BY_TOPIC:
            found.append(Watchdog(qos.liveliness_lease_s, self._lease_missed))
        return tuple(found)

    def _watched(self, take: Callable[[MessageT, int], None]) -> Callable[[MessageT, int], None]:
        def take_and_note(message: MessageT, size: int) -> None:
            for watchdog in self._watchdogs:
                watchdog.happened()
            if not self._alive and self.qos.liveliness is Liveliness.MANUAL_BY_TOPIC:
                self._set_alive(True)
            take(message, size)

        return take_and_note

    def _deadline_missed(self, total: int) -> None:
        assert self.qos.deadline_s is not None
        self.report(DeadlineMissed(self.topic, self.qos.deadline_s, total))

    def _lease_missed(self, total: int) -> None:  # noqa: ARG002
        self._set_alive(False)

    def sources_changed(self) -> None:
        """A publisher's connection came or went (called by the router)."""
        if self.qos.liveliness is Liveliness.AUTOMATIC:
            self._set_alive(self.publisher_count > 0)

    def _set_alive(self, alive: bool) -> None:
        if alive is not self._alive and not self._closed:
            self._alive = alive
            self.report(LivelinessChanged(self.topic, alive))

    def report(self, event: QosEvent) -> None:
        """Hand an event to the user's callback (called by the node)."""
        if self._on_event is not None:
            self._guard.call(self._on_event, event)

    # -- state ---------------------------------------------------------------------------------

    @property
    def has_received(self) -> bool:
        """Whether any message has arrived (asked by the router)."""
        return self._received > 0

    @property
    def publisher_count(self) -> int:
        """Connections that have brought messages for this subscription and still stand."""
        return len(self.route.sources) if self.route is not None else 0

    @property
    def statistics(self) -> SubscriberStatistics:
        """Counters so far."""
        queue = self._queue
        return SubscriberStatistics(
            self._received, queue.dropped, queue.expired, self._guard.errors, len(queue)
        )

    async def close(self) -> None:
        """Unsubscribe; nothing more is delivered."""
        if not self._closed:
            self.abandon()
            await self._node.forget_subscriber(self)

    unsubscribe = close

    def abandon(self, caller: asyncio.Task[Any] | None = None) -> None:
        """End at once, telling nobody (called by the node); cancels no task that is the caller."""
        self._closed = True
        self._queue.clear()
        self._wake_waiting()
        self._arrived.set()
        for watchdog in self._watchdogs:
            watchdog.stop()
        spared = (caller, asyncio.current_task(self._loop))
        if self._task is not None and self._task not in spared:
            self._task.cancel()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    def __repr__(self) -> str:
        state = "closed" if self._closed else f"{self._received} received"
        return f"<Subscriber {self.topic} [{self.msg_type}] {state}>"
