"""Open leases: streams whose standing is their node's sign of life.

Thin shell: what a lease means is decided in `simple_ros_master.directory`.
"""

from __future__ import annotations

import asyncio
from collections import deque

from simple_ros.rpc import master_pb2 as master

__all__ = ["LeaseDesk", "Mailbox"]

MAX_WAITING = 1000
"""Events that may wait for a holder that does not read; then the oldest are dropped."""


class Mailbox:
    """What one lease's stream still has to say.

    Attributes:
        number: The lease.
        error: Why the lease ended, if its opening was wrong.
    """

    def __init__(self, number: int) -> None:
        self.number = number
        self.error = ""
        self._events: deque[master.LeaseEvent] = deque(maxlen=MAX_WAITING)
        self._ended = False
        self._wake = asyncio.Event()

    def put(self, event: master.LeaseEvent) -> None:
        """Say something."""
        self._events.append(event)
        self._wake.set()

    def end(self, error: str = "") -> None:
        """Say nothing further after what was put so far."""
        self.error = self.error or error
        self._ended = True
        self._wake.set()

    async def get(self) -> master.LeaseEvent | None:
        """The next event, or None at the end."""
        while not self._events and not self._ended:
            self._wake.clear()
            await self._wake.wait()
        return self._events.popleft() if self._events else None


class LeaseDesk:
    """Numbers leases and delivers what is to be said to their holders."""

    def __init__(self) -> None:
        self._boxes: dict[int, Mailbox] = {}
        self._last = 0

    def open(self) -> Mailbox:
        """A mailbox under a new number."""
        self._last += 1
        box = self._boxes[self._last] = Mailbox(self._last)
        return box

    def close(self, box: Mailbox) -> None:
        """Forget a mailbox."""
        self._boxes.pop(box.number, None)

    def notice(self, lease: int, event: master.LeaseEvent) -> None:
        """Say something to a holder."""
        if lease in self._boxes:
            self._boxes[lease].put(event)

    def end(self, lease: int, error: str = "") -> None:
        """End a lease's stream."""
        if lease in self._boxes:
            self._boxes[lease].end(error)
