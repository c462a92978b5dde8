"""Subscriptions of the blocking face."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Generic, Self, TypeVar

from simple_ros.errors import HandleClosed
from simple_ros.executor import Executor
from simple_ros.message_queue import Token
from simple_ros.net.loop import BackgroundLoop
from simple_ros.qos import QosProfile
from simple_ros.subscriber import Subscriber as AsyncSubscriber
from simple_ros.subscriber import SubscriberStatistics

__all__ = ["Subscriber"]

AnyT = TypeVar("AnyT")


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
