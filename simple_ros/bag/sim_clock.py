"""The time of a simulation or a playback, as the topic ``/clock`` tells it."""

from __future__ import annotations

import asyncio

from simple_ros.msg.rosgraph_msgs import Clock
from simple_ros.node import NodeHandle

__all__ = ["SimClock"]


class SimClock:
    """Knows the last time that was told."""

    def __init__(self) -> None:
        self._now_ns = 0
        self._told = asyncio.Event()

    async def attach(self, node: NodeHandle) -> None:
        """Listen; returns when a time was told."""
        await node.subscribe("/clock", Clock, self._take)
        await self._told.wait()

    def _take(self, message: Clock) -> None:
        self._now_ns = message.clock.ToNanoseconds()
        self._told.set()

    def now_ns(self) -> int:
        """The last time that was told, in ns."""
        return self._now_ns
