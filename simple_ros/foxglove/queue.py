"""Messages that wait for one client: bounded in bytes, fair between channels. Pure.

Each channel has a lane of its own and lanes are served in turn, so that small messages never stand in
line behind images. When the bytes are used up, the oldest message of the largest lane falls; lanes
whose messages are few but matter (latched, or small on average) come last.
"""

from __future__ import annotations

from collections import deque
from typing import Generic, TypeVar

__all__ = ["OVERHEAD_BYTES", "SMALL_BYTES", "FairQueue"]

Item = TypeVar("Item")

SMALL_BYTES = 1024
"""Lanes with messages smaller than this on average are spared as long as others can give."""
OVERHEAD_BYTES = 200
"""What a waiting message costs beside its own bytes."""
_QUANTUM_BYTES = 64 * 1024


class _Lane(Generic[Item]):
    __slots__ = ("dropped", "items", "key", "limit", "size_bytes", "spared")

    def __init__(self, key: int, limit: int | None, spared: bool) -> None:
        self.key = key
        self.limit = limit
        self.spared = spared
        self.items: deque[tuple[Item, int]] = deque()
        self.size_bytes = 0
        self.dropped = 0

    @property
    def is_spared(self) -> bool:
        return self.spared or self.size_bytes < (SMALL_BYTES + OVERHEAD_BYTES) * len(self.items)


class FairQueue(Generic[Item]):
    """What waits for one client.

    Args:
        max_bytes: Bytes that may wait, with `OVERHEAD_BYTES` for each message.

    Attributes:
        size_bytes: Bytes that wait, overhead included.
    """

    def __init__(self, max_bytes: int) -> None:
        self.max_bytes = max_bytes
        self.size_bytes = 0
        self._lanes: dict[int, _Lane[Item]] = {}
        self._turns: deque[_Lane[Item]] = deque()

    def __bool__(self) -> bool:
        return bool(self._turns)

    @property
    def waiting(self) -> int:
        """Messages that wait."""
        return sum(len(lane.items) for lane in self._turns)

    @property
    def dropped(self) -> dict[int, int]:
        """Messages that fell, by channel, where any did."""
        return {key: lane.dropped for key, lane in self._lanes.items() if lane.dropped}

    def open(self, key: int, *, limit: int | None = None, spared: bool = False) -> None:
        """Take messages of a channel from now on.

        Args:
            key: The channel.
            limit: Only so many of its messages wait, the newest; None for no such limit.
            spared: Whether its messages fall last, whatever their size.
        """
        self._lanes[key] = _Lane(key, limit, spared)

    def spare(self, key: int) -> None:
        """Let messages of an open channel fall last, whatever their size."""
        lane = self._lanes.get(key)
        if lane is not None:
            lane.spared = True

    def close(self, key: int) -> None:
        """Take no more messages of a channel; what waits is given up."""
        lane = self._lanes.pop(key, None)
        if lane is not None and lane.items:
            self._turns.remove(lane)
            self.size_bytes -= lane.size_bytes

    def clear(self) -> None:
        """Give up all that waits."""
        for lane in self._turns:
            lane.items.clear()
            lane.size_bytes = 0
        self._turns.clear()
        self.size_bytes = 0

    def push(self, key: int, item: Item, size_bytes: int) -> int:
        """Append a message to an open channel.

        Returns:
            How many messages fell for lack of room, this one perhaps; those that a newer one of a
            limited channel replaces are not among them.
        """
        lane = self._lanes[key]
        size = size_bytes + OVERHEAD_BYTES
        if size > self.max_bytes:
            lane.dropped += 1
            return 1
        if not lane.items:
            self._turns.append(lane)
        elif lane.limit is not None and len(lane.items) >= lane.limit:
            self._drop_oldest(lane)
        lane.items.append((item, size))
        lane.size_bytes += size
        self.size_bytes += size
        return self._make_room() if self.size_bytes > self.max_bytes else 0

    def _make_room(self) -> int:
        count = 0
        while self.size_bytes > self.max_bytes:
            lane = max(self._turns, key=lambda lane: (not lane.is_spared, lane.size_bytes))
            self._drop_oldest(lane)
            lane.dropped += 1
            count += 1
            if not lane.items:
                self._turns.remove(lane)
        return count

    def _drop_oldest(self, lane: _Lane[Item]) -> None:
        _, size = lane.items.popleft()
        lane.size_bytes -= size
        self.size_bytes -= size

    def take(self, most_bytes: int) -> list[tuple[int, Item]]:
        """The next messages with their channels: about as many as fit, at least one if any waits.

        Lanes take turns; a lane may send small messages up to 64 KiB in one turn, or one message.
        """
        taken: list[tuple[int, Item]] = []
        budget = most_bytes
        turns = self._turns
        while turns and budget > 0:
            lane = turns.popleft()
            quantum = min(budget, _QUANTUM_BYTES)
            items, key = lane.items, lane.key
            used = 0
            while items and used < quantum:
                item, size = items.popleft()
                taken.append((key, item))
                used += size
            lane.size_bytes -= used
            self.size_bytes -= used
            budget -= used
            if items:
                turns.append(lane)
        return taken
