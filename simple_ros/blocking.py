"""The blocking face: nodes, publishers, subscribers and timers for programs without an event loop.

Everything forwards to the asyncio classes, which run on one background loop. Callbacks and timers run
in the thread that spins (`simple_ros.system_manager`), none before. What one read of a link brought
crosses to that thread in one piece.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, Generic, Self, TypeVar, overload

from google.protobuf.message import Message

from simple_ros.errors import HandleClosed
from simple_ros.events import QosEventCallback
from simple_ros.executor import Executor, ScheduledCall
from simple_ros.message_queue import DEFAULT_GROUP, CallbackGroup, Token
from simple_ros.net.loop import BackgroundLoop
from simple_ros.net.master_client import MasterClient
from simple_ros.node import NodeHandle as AsyncNodeHandle
from simple_ros.node import profile_of
from simple_ros.publisher import Publisher as AsyncPublisher
from simple_ros.publisher import PublisherStatistics
from simple_ros.qos import DEFAULT, QosProfile
from simple_ros.schedule import TimerEvent, TimerSchedule
from simple_ros.subscriber import Subscriber as AsyncSubscriber
from simple_ros.subscriber import SubscriberStatistics

__all__ = ["BlockingNode", "Publisher", "Subscriber", "Timer"]

MessageT = TypeVar("MessageT", bound=Message)
AnyT = TypeVar("AnyT")

_BACKLOG = 1024


class Publisher(Generic[MessageT]):
    """Sends messages of one type on one topic. Made by `NodeHandle.advertise`.

    May be used from any thread.
    """

    def __init__(self, loop: BackgroundLoop, publisher: AsyncPublisher[MessageT]) -> None:
        self._loop = loop
        self._publisher = publisher
        self._class = publisher.message_class
        self._blocks = publisher.qos.overflow == "block"
        self._backlog: deque[bytes] = deque()
        self._scheduled = False
        self._room = threading.Condition()
        self._handed_over = asyncio.Event()

    @property
    def topic(self) -> str:
        """Canonical topic name."""
        return self._publisher.topic

    @property
    def msg_type(self) -> str:
        """Full protobuf name."""
        return self._publisher.msg_type

    @property
    def qos(self) -> QosProfile:
        """What is offered."""
        return self._publisher.qos

    def publish(self, message: MessageT) -> None:
        """Send to every subscriber.

        Waits for subscribers only with ``overflow="block"``; otherwise at most for this process's own
        sending thread, if it is 1,024 messages behind.

        Raises:
            TypeError: The message is of another type than the topic.
            HandleClosed: The publisher or its node is closed.
            NodeNameTaken: A newer node runs under this node's name.
        """
        if message.__class__ is not self._class:
            self._publisher.check_type(message)
        self.publish_bytes(message.SerializeToString())

    def publish_bytes(self, payload: bytes) -> None:
        """Send a message that is serialised already. Raises as `publish`."""
        self._publisher.check_open()
        if len(self._backlog) >= _BACKLOG and not self._loop.is_current:
            self._wait_for_room()
        self._backlog.append(payload)
        if not self._scheduled:
            self._scheduled = True
            self._loop.call_soon(self._hand_over)

    def _wait_for_room(self) -> None:
        with self._room:
            while len(self._backlog) >= _BACKLOG:
                self._room.wait(0.1)
                self._publisher.check_open()

    def _hand_over(self) -> None:
        """On the loop's thread: pass on everything that has gathered."""
        if self._blocks:
            self._loop.start(self._hand_over_blocking())
            return
        # Cleared first: what is appended from here on schedules another turn.
        self._scheduled = False
        backlog, publish = self._backlog, self._publisher.publish_bytes
        try:
            while backlog:
                publish(backlog.popleft())
        except (HandleClosed, RuntimeError):
            backlog.clear()
        self._tell_room()

    async def _hand_over_blocking(self) -> None:
        self._handed_over.clear()
        try:
            while self._backlog:
                await self._publisher.publish_bytes_async(self._backlog[0])
                self._backlog.popleft()
                if len(self._backlog) == _BACKLOG // 2:
                    self._tell_room()
        except (HandleClosed, RuntimeError):
            self._backlog.clear()
        self._scheduled = False
        self._tell_room()
        self._handed_over.set()
        if self._backlog and not self._scheduled:
            self._scheduled = True
            self._loop.call_soon(self._hand_over)

    def _tell_room(self) -> None:
        with self._room:
            self._room.notify_all()

    @property
    def subscriber_count(self) -> int:
        """Subscribers that are linked now."""
        return self._publisher.subscriber_count

    def wait_for_subscribers(self, count: int = 1, timeout: float | None = None) -> None:
        """Wait until at least ``count`` subscribers are linked.

        Raises:
            TimeoutError: Not within ``timeout`` seconds.
        """
        self._loop.run(self._publisher.wait_for_subscribers(count, timeout))

    @property
    def statistics(self) -> PublisherStatistics:
        """Counters so far."""
        return self._publisher.statistics

    def flush(self, timeout: float | None = None) -> None:
        """Wait until everything published has been handed to the operating system.

        Raises:
            TimeoutError: Not within ``timeout`` seconds.
        """
        self._loop.run(self._flush(timeout))

    async def _flush(self, timeout: float | None) -> None:
        if self._blocks:
            async with asyncio.timeout(timeout):
                while self._backlog:
                    # A turn of the loop, for a hand-over that was only just asked for.
                    await asyncio.sleep(0)
                    await self._handed_over.wait()
        else:
            self._hand_over()
        await self._publisher.flush(timeout)

    def close(self) -> None:
        """Stop publishing: send what waits (up to 0.5 s), unregister, end the links."""
        self._loop.run(self._close())

    async def _close(self) -> None:
        if not self._blocks:
            self._hand_over()
        await self._publisher.close()

    unregister = close

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return repr(self._publisher)


class Subscriber(Generic[AnyT]):
    """Receives messages of one type on one topic. Made by `NodeHandle.subscribe`.

    With a callback, messages are delivered while some thread spins. Without, `receive` and iteration
    take them. It lives until closed: the node holds it.
    """

    def __init__(self, loop: BackgroundLoop, executor: Executor, token: Token | None) -> None:
        self._loop = loop
        self._executor = executor
        self._token = token
        self._subscriber: AsyncSubscriber[AnyT] | None = None

    def attach(self, subscriber: AsyncSubscriber[AnyT]) -> None:
        """The subscription that feeds this one (called by the node)."""
        self._subscriber = subscriber

    def tell_room(self) -> None:
        """Messages were taken from the queue (called by it, in whichever thread)."""
        if self._live.is_waited_for:
            self._loop.call_soon(self._live.room_made)

    @property
    def _live(self) -> AsyncSubscriber[AnyT]:
        assert self._subscriber is not None
        return self._subscriber

    @property
    def topic(self) -> str:
        """Canonical topic name."""
        return self._live.topic

    @property
    def msg_type(self) -> str:
        """Full protobuf name."""
        return self._live.msg_type

    @property
    def qos(self) -> QosProfile:
        """What is requested."""
        return self._live.qos

    def receive(self, timeout: float | None = None) -> AnyT:
        """The next message (of a subscription without callback).

        Raises:
            TimeoutError: Not within ``timeout`` seconds.
            HandleClosed: The subscription is closed.
        """
        return self._loop.run(self._live.receive_within(timeout))

    def __iter__(self) -> Iterator[AnyT]:
        """Messages until the subscription is closed."""
        while True:
            try:
                message = self.receive()
            except HandleClosed:
                return
            yield message

    @property
    def publisher_count(self) -> int:
        """Connections that have brought messages for this subscription and still stand."""
        return self._live.publisher_count

    @property
    def statistics(self) -> SubscriberStatistics:
        """Counters so far."""
        statistics = self._live.statistics
        token = self._token
        if token is None:
            return statistics
        return SubscriberStatistics(
            statistics.received,
            statistics.dropped + token.dropped,
            statistics.expired,
            token.guard.errors,
            len(token.waiting),
        )

    def close(self) -> None:
        """Unsubscribe; nothing more is delivered."""
        if self._token is not None:
            self._executor.queue.remove_subscriber(self._token)
        self._loop.run(self._live.close())

    unsubscribe = close

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return repr(self._subscriber)


class Timer:
    """Calls a callback in the thread that spins. Made by `NodeHandle.create_timer`."""

    def __init__(
        self,
        executor: Executor,
        schedule: TimerSchedule,
        callback: Callable[[TimerEvent], object],
        group: CallbackGroup,
    ) -> None:
        self._executor = executor
        self._schedule = schedule
        self._call = ScheduledCall(schedule, callback, group)
        self._closed = False
        executor.add_timer(self._call)

    @property
    def period(self) -> float:
        """Seconds between calls; a running timer starts over when it is set."""
        return self._schedule.period_s

    @period.setter
    def period(self, period_s: float) -> None:
        self._schedule.set_period(period_s, time.monotonic())
        self._executor.timers_changed()

    @property
    def is_running(self) -> bool:
        """Whether a call is due some time."""
        return self._schedule.due is not None

    @property
    def errors(self) -> int:
        """Exceptions of the callback so far."""
        return self._call.guard.errors

    def start(self) -> None:
        """Run from now; no effect while running or paused.

        Raises:
            HandleClosed: The timer is closed.
        """
        if self._closed:
            raise HandleClosed("timer")
        self._schedule.start(time.monotonic())
        self._executor.timers_changed()

    def stop(self) -> None:
        """Stop; `start` begins anew."""
        self._schedule.stop()

    def pause(self) -> None:
        """Hold; `resume` goes on."""
        self._schedule.pause(time.monotonic())

    def resume(self) -> None:
        """Go on: a periodic timer with a full period, a one-shot with what was left."""
        if not self._closed:
            self._schedule.resume(time.monotonic())
            self._executor.timers_changed()

    def set_one_shot(self, oneshot: bool) -> None:
        """Whether to stop after the next call."""
        self._schedule.oneshot = oneshot

    def close(self) -> None:
        """Stop for good."""
        self._closed = True
        self._schedule.stop()
        self._executor.remove_timer(self._call)


class BlockingNode:
    """A node on the background loop, whose callbacks run where an executor spins.

    What `simple_ros.system_manager.NodeHandle` is made of.
    """

    def __init__(self, loop: BackgroundLoop, executor: Executor, node: AsyncNodeHandle) -> None:
        self._loop = loop
        self._executor = executor
        self._node = node
        self._timers: set[Timer] = set()

    @property
    def name(self) -> str:
        """Canonical node name."""
        return self._node.name

    @property
    def ip(self) -> str:
        """The dotted IPv4 that peers see."""
        return self._node.ip

    @property
    def port(self) -> int:
        """The port the node listens on."""
        return self._node.port

    def wait_for_master(self, timeout: float | None = None) -> None:
        """Return when the Master has answered.

        Raises:
            TimeoutError: Not within ``timeout`` seconds.
        """
        self._loop.run(self._node.wait_for_master(timeout))

    @property
    def client(self) -> MasterClient:
        """The connection to the Master, whose calls are coroutines of the background loop."""
        return self._node.client

    def advertise(
        self,
        topic: str,
        message_class: type[MessageT],
        *,
        qos: QosProfile | int = DEFAULT,
        on_event: QosEventCallback | None = None,
    ) -> Publisher[MessageT]:
        """A publisher on a topic; see `simple_ros.aio.NodeHandle.advertise`."""
        publisher = self._loop.run(
            self._node.advertise(topic, message_class, qos=qos, on_event=self._handed(on_event))
        )
        return Publisher(self._loop, publisher)

    @overload
    def subscribe(
        self,
        topic: str,
        message_type: type[MessageT],
        callback: Callable[[MessageT], object] | None = None,
        *,
        qos: QosProfile | int = DEFAULT,
        on_event: QosEventCallback | None = None,
        group: CallbackGroup = DEFAULT_GROUP,
    ) -> Subscriber[MessageT]: ...

    @overload
    def subscribe(
        self,
        topic: str,
        message_type: str,
        callback: Callable[[Any], object] | None = None,
        *,
        qos: QosProfile | int = DEFAULT,
        on_event: QosEventCallback | None = None,
        raw: bool = False,
        group: CallbackGroup = DEFAULT_GROUP,
    ) -> Subscriber[Any]: ...

    def subscribe(
        self,
        topic: str,
        message_type: type[Message] | str,
        callback: Callable[[Any], object] | None = None,
        *,
        qos: QosProfile | int = DEFAULT,
        on_event: QosEventCallback | None = None,
        raw: bool = False,
        group: CallbackGroup = DEFAULT_GROUP,
    ) -> Subscriber[Any]:
        """A subscription to a topic; see `simple_ros.aio.NodeHandle.subscribe`.

        Args:
            topic: Topic name.
            message_type: Class of its messages, or their full name.
            callback: Called in a thread that spins. None leaves messages to
                `Subscriber.receive` and ``for message in subscriber``.
            qos: What is requested; a number is a depth.
            on_event: Called in a thread that spins.
            raw: With a type name: ``bytes``, not parsed.
            group: What the callback may run at the same time with, if several threads spin.
        """
        queue = self._executor.queue
        token = None
        deliver: Callable[[list[Any]], None] | None = None
        room: Callable[[], int] | None = None
        if callback is not None:
            token = queue.add_subscriber(topic, callback, depth=profile_of(qos).depth, group=group)
            deliver = _delivery(queue.deliver, token)
            if profile_of(qos).overflow == "block":
                room = token.room
        subscriber: Subscriber[Any] = Subscriber(self._loop, self._executor, token)
        try:
            subscriber.attach(
                self._loop.run(
                    self._node.subscribe_batches(
                        topic,
                        message_type,
                        deliver,
                        qos=qos,
                        on_event=self._handed(on_event),
                        raw=raw,
                        room=room,
                    )
                )
            )
            if token is not None and room is not None:
                token.on_room = subscriber.tell_room
        except BaseException:
            if token is not None:
                queue.remove_subscriber(token)
            raise
        return subscriber

    def create_timer(
        self,
        period: float,
        callback: Callable[[TimerEvent], object],
        oneshot: bool = False,
        *,
        start: bool = True,
        group: CallbackGroup = DEFAULT_GROUP,
    ) -> Timer:
        """A timer that calls ``callback`` every ``period`` seconds, first after one period."""
        timer = Timer(self._executor, TimerSchedule(period, oneshot=oneshot), callback, group)
        self._timers.add(timer)
        if start:
            timer.start()
        return timer

    def _handed(self, on_event: QosEventCallback | None) -> QosEventCallback | None:
        """The same callback, called in a thread that spins."""
        if on_event is None:
            return None
        return lambda event: self._executor.call_soon(lambda: on_event(event))

    def close(self) -> None:
        """Send what still waits, say goodbye to the Master, end everything."""
        for timer in self._timers:
            timer.close()
        self._loop.run(self._node.close())


def _delivery(
    deliver: Callable[[Token, list[Any]], None], token: Token
) -> Callable[[list[Any]], None]:
    return lambda messages: deliver(token, messages)
