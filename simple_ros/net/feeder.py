"""Paces delivery: a burst does not overrun the queue of a subscription that keeps up on average.

One read of a socket can bring thousands of messages, while a subscription with a coroutine callback
or ``async for`` holds ``depth``. So when a queue is full, the rest of the burst waits for one turn of
the event loop, in which a consumer that keeps up empties its queue; only then are its oldest
messages dropped. Meanwhile the link is not read, so TCP holds the sender back.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Hashable, Iterable
from typing import Protocol

from simple_ros.wire.framing import LENT_BYTES, Run

__all__ = ["NO_LANE", "Feeder", "Lane", "LinkReceiver", "Receiver", "Source"]


class Source(Hashable, Protocol):
    """A link as its receiver sees it."""

    def expect_life_within(self, seconds: float) -> None:
        """Let the link end if its peer's host gives no sign of life for so long."""


class Lane(Protocol):
    """Where the frames of one link with one header go.

    Attributes:
        take_lone: Takes a message that came alone, with nothing waiting before it; None if that goes the
            way of all others.
    """

    take_lone: Callable[[bytes], object] | None


class _NoLane:
    take_lone: Callable[[bytes], object] | None = None


NO_LANE: Lane = _NoLane()


class Receiver(Protocol):
    """Where the messages of links go."""

    def receive(self, link: Source, run: Run, resume: Callable[[], None], *, force: bool) -> int:
        """Take messages; their payloads are views that end with the call.

        Args:
            link: Where they came from.
            run: The messages.
            resume: To be called once there is room, if the answer is negative.
            force: Do not wait for room any longer; drop instead.

        Returns:
            How many messages were taken; fewer than there are if queues are full now. -1 if nothing
            can be taken until ``resume`` is called.
        """

    def link_refused(self, peer: str, reason: str) -> None:
        """A stream from host ``peer`` was no simple_ros stream and is closed."""

    def link_ended(self, link: Source) -> None:
        """The peer closed, or was closed."""


class LinkReceiver(Receiver, Protocol):
    """Where the messages of connections go."""

    def lane_of(self, link: Source, header: bytes) -> Lane:
        """Where the last frames went that came on a link with a header; `NO_LANE` if nowhere."""


class Feeder:
    """Hands the runs of one link to a receiver, as fast as its queues allow.

    Args:
        link: What the receiver is told the messages came from.
        receiver: Where they go.
        on_stalled: Stop reading.
        on_flowing: Read on.
    """

    def __init__(
        self,
        link: Source,
        receiver: Receiver,
        on_stalled: Callable[[], None],
        on_flowing: Callable[[], None],
    ) -> None:
        self._link = link
        self._receive = receiver.receive
        self._on_stalled = on_stalled
        self._on_flowing = on_flowing
        self._loop = asyncio.get_running_loop()
        self._backlog: deque[Run] = deque()
        self._stalled = False
        self._closed = False

    @property
    def is_stalled(self) -> bool:
        """Whether messages wait for room."""
        return self._stalled

    def feed(self, runs: Iterable[Run]) -> None:
        """Deliver; what does not fit now is delivered later, with the link stalled meanwhile."""
        receive, link, resume = self._receive, self._link, self._resume
        for run in runs:
            if self._stalled:
                self._backlog.append(_kept(run))
                continue
            taken = receive(link, run, resume, force=False)
            if taken < len(run.payloads):
                self._hold(run, taken)

    def _deliver(self, run: Run, *, force: bool) -> bool:
        """Deliver one run whole; False if the rest of it is now first in the backlog."""
        taken = self._receive(self._link, run, self._resume, force=force)
        if taken >= len(run.payloads):
            return True
        self._hold(run, taken)
        return False

    def _hold(self, run: Run, taken: int) -> None:
        """Keep what was not taken of a run for later."""
        if taken > 0:
            run = run._replace(payloads=run.payloads[taken:])
        self._backlog.appendleft(_kept(run))
        if not self._stalled:
            self._stalled = True
            self._on_stalled()
        if taken >= 0:
            self._loop.call_soon(self._resume)

    def _resume(self) -> None:
        force = True
        while self._backlog and not self._closed:
            if not self._deliver(self._backlog.popleft(), force=force):
                return
            force = False
        if self._stalled:
            self._stalled = False
            self._on_flowing()

    def close(self) -> int:
        """Deliver nothing more; return how many messages that gave up."""
        self._closed = True
        given_up = sum(len(run.payloads) for run in self._backlog)
        self._backlog.clear()
        return given_up


def _kept(run: Run) -> Run:
    """A run that outlives the buffer it was read into: some transports bring more while a link rests."""
    return run._replace(
        payloads=[
            bytes(item) if isinstance(item, memoryview) and len(item) < LENT_BYTES else item
            for item in run.payloads
        ]
    )
