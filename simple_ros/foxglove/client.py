"""One connected client: its conversation, what waits for it, and its connection."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from simple_ros.callbacks import CallbackGuard
from simple_ros.foxglove import frames
from simple_ros.foxglove.connection import Connection
from simple_ros.foxglove.events import Event
from simple_ros.foxglove.frames import Level
from simple_ros.foxglove.queue import FairQueue
from simple_ros.foxglove.session import Frame, Session
from simple_ros.foxglove.slowness import SlowNotice

__all__ = ["Client", "ClientStatistics", "Message"]

Message = tuple[bytes, bytes, bytes]
"""A message in the parts of `frames.message_parts`."""

_BATCH_BYTES = 64 * 1024
_LARGE_BYTES = 16 * 1024
_CONTROL_BYTES = 16 * 1024 * 1024
_TIME_EVERY_NS = 5_000_000
_OVERFLOW = "Too many answers wait for this client; the connection is closed"


@dataclass(frozen=True, slots=True)
class ClientStatistics:
    """What happened to one client's messages.

    Attributes:
        peer: Its address.
        subprotocol: What it speaks.
        subscriptions: Channels it is subscribed to.
        sent: Messages sent.
        sent_bytes: Their bytes.
        waiting: Messages that wait.
        waiting_bytes: Their bytes, with what keeping them costs.
        dropped: Messages that fell, by channel id, of channels still subscribed.
        dropped_total: Messages that fell, of all channels.
        refused: Requests that made no sense or were not granted.
    """

    peer: str
    subprotocol: str
    subscriptions: int
    sent: int
    sent_bytes: int
    waiting: int
    waiting_bytes: int
    dropped: dict[int, int]
    dropped_total: int
    refused: int


class Client:
    """Joins a `Session`, a `FairQueue` and a `Connection`.

    Args:
        connection: Which stands.
        session: Of this client.
        max_bytes: How much may wait for it.
        clock_ns: The time that it is told; None tells none.
        on_event: Called with each thing the client does.
        on_lost: Called when it has gone.
    """

    def __init__(
        self,
        connection: Connection,
        session: Session,
        max_bytes: int,
        clock_ns: Callable[[], int] | None,
        on_event: Callable[[Client, Event], None],
        on_lost: Callable[[Client], None],
    ) -> None:
        self.session = session
        self.queue: FairQueue[Message] = FairQueue(max_bytes)
        self._connection = connection
        self._clock_ns = clock_ns
        self._on_event = on_event
        self._on_lost = on_lost
        self._loop = asyncio.get_running_loop()
        self._guard = CallbackGuard(f"foxglove client {connection.peer}")
        self._notice = SlowNotice()
        self._control: deque[Frame] = deque()
        self._control_bytes = 0
        self._control_limit = _CONTROL_BYTES
        self._is_scheduled = False
        self._ended = False
        self._subscriptions: dict[int, bytes] = {}
        self._told_ns = 0
        self._sent = 0
        self._sent_bytes = 0
        self._dropped = 0
        self._drained: list[asyncio.Future[None]] = []

    @property
    def statistics(self) -> ClientStatistics:
        """Counters so far."""
        queue = self.queue
        return ClientStatistics(
            self._connection.peer,
            self._connection.subprotocol,
            len(self._subscriptions),
            self._sent,
            self._sent_bytes,
            queue.waiting,
            queue.size_bytes,
            queue.dropped,
            self._dropped,
            self.session.refused,
        )

    # -- the connection's calls ----------------------------------------------------------------

    def received(self, message: str | bytes) -> None:
        """A message of the client came."""
        self.session.receive(message)
        self.process()

    def writable(self) -> None:
        """The socket takes bytes again."""
        # Not at once: a transport that tells so does not bear a write that fails meanwhile.
        self._schedule()

    def lost(self) -> None:
        """The client has gone."""
        self._ended = True
        self._on_lost(self)
        self.session.end()
        self.process()
        self._wake_waiting()

    # -- the conversation ----------------------------------------------------------------------

    def begin(self, server_info: str) -> None:
        """Introduce the server and all it offers."""
        self.session.begin(server_info)
        offered = self.session.frames()
        # Thousands of topics are more than may wait otherwise, and time going back repeats them.
        self._control_limit += 2 * sum(map(len, offered))
        for frame in offered:
            self._put_control(frame)

    def process(self) -> None:
        """Hand on what the conversation gave rise to."""
        for frame in self.session.frames():
            self._put_control(frame)
        for event in self.session.events():
            self._guard.call(self._on_event, self, event)
        # An event may be answered at once.
        for frame in self.session.frames():
            self._put_control(frame)

    def _put_control(self, frame: Frame) -> None:
        if self._ended:
            return
        if self._control_bytes > self._control_limit:
            self._connection.send(frames.status(Level.ERROR, _OVERFLOW))
            self._connection.close(1013, "too slow")
            self._ended = True
            return
        self._control.append(frame)
        self._control_bytes += len(frame)
        self._schedule()

    async def drained(self) -> None:
        """Return when little of the conversation waits to be sent, or the client has gone."""
        while self._control_bytes > _BATCH_BYTES and not self._ended:
            future = self._loop.create_future()
            self._drained.append(future)
            await future

    def _wake_waiting(self) -> None:
        waiting, self._drained = self._drained, []
        for future in waiting:
            if not future.done():
                future.set_result(None)

    # -- messages ------------------------------------------------------------------------------

    def open(self, channel: int, subscription: int, limit: int | None, *, spared: bool) -> None:
        """Send messages of a channel from now on; see `FairQueue.open`."""
        self.queue.open(channel, limit=limit, spared=spared)
        self._subscriptions[channel] = subscription.to_bytes(4, "little")

    def stop(self, channel: int) -> None:
        """Send messages of a channel no more, not even those that wait."""
        self._subscriptions.pop(channel, None)
        self.queue.close(channel)

    def put(self, channel: int, message: Message, size_bytes: int) -> None:
        """Send a message of an open channel as soon as it is its turn."""
        fallen = self.queue.push(channel, message, size_bytes)
        if fallen:
            self._dropped += fallen
            notice = self._notice.dropped(self._loop.time())
            if notice is not None:
                self._put_control(notice)
        if not self._is_scheduled:
            self._schedule()

    def tick(self) -> None:
        """Some time has passed: tell the time, take back what no longer holds."""
        notice = self._notice.tick(self._loop.time())
        if notice is not None:
            self._put_control(notice)
        # Old times are worth nothing, so they never wait.
        if self._connection.is_writable and not self._control:
            self._tell_time(0)

    def jump(self) -> None:
        """Playback goes on elsewhere: what waits is of no use, and time may go back."""
        self.queue.clear()
        self._told_ns = 0

    def reset_time(self, server_info: str) -> None:
        """Time went back: let the client forget what it showed."""
        self.jump()
        self.session.begin_again(server_info)
        self.process()

    # -- writing -------------------------------------------------------------------------------

    def _schedule(self) -> None:
        if self._connection.is_writable and not self._is_scheduled:
            self._is_scheduled = True
            self._loop.call_soon(self._write)

    def _write(self) -> None:
        """Write as much as the socket takes: the conversation first, then messages in turn."""
        self._is_scheduled = False
        connection = self._connection
        while connection.is_writable and self._control:
            frame = self._control.popleft()
            self._control_bytes -= len(frame)
            connection.send(frame)
        if self._drained and self._control_bytes <= _BATCH_BYTES:
            self._wake_waiting()
        if self.queue and connection.is_writable:
            self._tell_time(_TIME_EVERY_NS)
        while connection.is_writable and self.queue:
            self._write_messages()

    def _write_messages(self) -> None:
        parts: list[bytes] = []
        subscriptions = self._subscriptions
        batch = self.queue.take(_BATCH_BYTES)
        size = 0
        for channel, (head, stamp, data) in batch:
            parts += (head, subscriptions[channel], stamp, data)
            size += len(data)
        self._sent += len(batch)
        self._sent_bytes += size
        if self._connection.compresses:
            # Compressing is the library's, frame by frame: the last byte of a head is the message's first.
            for begin in range(0, len(parts), 4):
                head, *rest = parts[begin : begin + 4]
                self._connection.send(b"".join((head[-1:], *rest)))
            return
        large = size > _LARGE_BYTES * len(batch)
        self._connection.send_raw(parts if large else (b"".join(parts),))

    def _tell_time(self, at_least_ns: int) -> None:
        if self._clock_ns is None:
            return
        now = self._clock_ns()
        if now and now - self._told_ns > at_least_ns:
            self._told_ns = now
            self._connection.send(frames.time_frame(now))

    def close(self, code: int, reason: str) -> None:
        """Say goodbye to the client."""
        self._connection.close(code, reason)

    def cut(self) -> None:
        """End the connection at once."""
        self._connection.abort()
