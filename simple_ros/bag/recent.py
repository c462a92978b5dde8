"""The last messages, for recordings that are written only when something has happened. Pure.

What is latched is kept however old it is: without the map, the last minute means little.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from itertools import chain

from simple_ros.bag.series import RecordedTopic

__all__ = ["RecentMessages"]

Batch = tuple[RecordedTopic, int, Sequence[bytes]]


class RecentMessages:
    """Keeps messages, the newest of them, bounded in bytes.

    Args:
        max_bytes: How much is kept; latched messages come on top.
    """

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes = max_bytes
        self._size_bytes = 0
        self._batches: deque[Batch] = deque()
        self._old_latched: dict[RecordedTopic, Batch] = {}

    def add(self, topic: RecordedTopic, stamp_ns: int, payloads: Sequence[bytes]) -> None:
        """Messages have come, at one time in ns since 1970."""
        self._batches.append((topic, stamp_ns, payloads))
        self._size_bytes += sum(map(len, payloads))
        while self._size_bytes > self._max_bytes and len(self._batches) > 1:
            oldest = self._batches.popleft()
            self._size_bytes -= sum(map(len, oldest[2]))
            if oldest[0].history is not None:
                self._old_latched[oldest[0]] = (oldest[0], oldest[1], oldest[2][-1:])

    def taken(self) -> list[Batch]:
        """What is kept, oldest first; from now on only what is latched and comes anew is."""
        found = list(chain(self._old_latched.values(), self._batches))
        for topic, stamp_ns, payloads in self._batches:
            if topic.history is not None:
                self._old_latched[topic] = (topic, stamp_ns, payloads[-1:])
        self._batches.clear()
        self._size_bytes = 0
        return sorted(found, key=lambda batch: batch[1])
