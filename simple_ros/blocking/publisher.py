"""Publishers of the blocking face."""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from typing import Generic, Self, TypeVar

from simple_ros.errors import HandleClosed
from simple_ros.net.loop import BackgroundLoop
from simple_ros.publisher import Publisher as AsyncPublisher
from simple_ros.publisher import PublisherStatistics
from simple_ros.qos import QosProfile

__all__ = ["Publisher"]

MessageT = TypeVar("MessageT")

_BACKLOG = 1024
_CHUNK = 256


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
        self.publish_bytes(self._publisher.encode(message))

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
        try:
            while self._backlog:
                chunk = self._chunk()
                if not self._publisher.publish_batch(chunk):
                    for payload in chunk:
                        self._publisher.publish_bytes(payload)
        except (HandleClosed, RuntimeError):
            self._backlog.clear()
        self._tell_room()

    def _chunk(self) -> list[bytes]:
        backlog = self._backlog
        return [backlog.popleft() for _ in range(min(len(backlog), _CHUNK))]

    async def _hand_over_blocking(self) -> None:
        self._handed_over.clear()
        try:
            while self._backlog:
                chunk = self._chunk()
                if not self._publisher.publish_batch(chunk):
                    # One waits for room, with the others still in the backlog.
                    self._backlog.extendleft(reversed(chunk))
                    await self._publisher.publish_bytes_async(self._backlog[0])
                    self._backlog.popleft()
                if len(self._backlog) <= _BACKLOG // 2:
                    self._tell_room()
                    await asyncio.sleep(0)
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
