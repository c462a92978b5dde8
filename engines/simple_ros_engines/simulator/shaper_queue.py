"""One direction of one shaped link: what waits, class by class, and what was counted. SIMULATED; pure."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any
from zlib import crc32

import numpy as np

from simple_ros_engines.simulator.shaper_settings import Conditions, Overflow, TopicClass

__all__ = ["ClassCounts", "DirectionQueue", "Flow", "Waiting"]

_KEPT_LATENCIES = 1024


@dataclass(slots=True)
class ClassCounts:
    """What became of the messages of one class in one direction of a link.

    Each message offered is in exactly one of: delivered, dropped, lost, expired, or still on its way.

    Attributes:
        offered: Messages that came.
        offered_bytes: Their size.
        delivered: Messages handed on.
        delivered_bytes: Their size.
        late: Of the delivered, those older than the deadline.
        dropped: Given up for want of room.
        lost: Lost on the air.
        expired: Given up for their age.
        latencies_s: Of the newest messages delivered.
    """

    offered: int = 0
    offered_bytes: int = 0
    delivered: int = 0
    delivered_bytes: int = 0
    late: int = 0
    dropped: int = 0
    lost: int = 0
    expired: int = 0
    latencies_s: deque[float] = field(default_factory=lambda: deque(maxlen=_KEPT_LATENCIES))

    @property
    def missed(self) -> int:
        """Messages that did not arrive in time: late, dropped, lost or expired."""
        return self.late + self.dropped + self.lost + self.expired

    def latency_s(self, share: float) -> float:
        """The latency that so large a share of the newest messages did not exceed; NaN without any."""
        ordered = sorted(self.latencies_s)
        return ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else math.nan


@dataclass(slots=True, eq=False)
class Flow:
    """One connection over one direction of a link: keeps order, and has its own chance.

    Attributes:
        topic: Name.
        class_index: Its class.
        handle: Whatever the caller wants to be given back.
        last_s: When its newest message arrives.
        on_way: Its messages that are neither arrived nor given up.
    """

    topic: str
    class_index: int
    handle: Any = None
    last_s: float = -math.inf
    on_way: int = 0
    generator: np.random.Generator = field(default_factory=np.random.default_rng, repr=False)

    def jitter_s(self, mean_s: float) -> float:
        """A delay by chance."""
        return min(5.0, float(self.generator.standard_exponential())) * mean_s

    def is_lost(self, share: float) -> bool:
        """Whether a message is lost."""
        return float(self.generator.random()) < share


@dataclass(slots=True, eq=False)
class Waiting:
    """A message on its way.

    Attributes:
        flow: Its connection.
        class_index: The class it waits in.
        item: The message.
        size: Bytes.
        entered_s: When it came.
        left_bytes: What of it has not been sent yet.
    """

    flow: Flow
    class_index: int
    item: Any
    size: int
    entered_s: float
    left_bytes: float


class DirectionQueue:
    """What waits in one direction of a link.

    Args:
        name: Of the link and its direction; chance depends on it.
        conditions: At first.
        classes: All there are.
        seed: Of chance.
    """

    def __init__(
        self, name: str, conditions: Conditions, classes: Sequence[TopicClass], seed: int
    ) -> None:
        self.name = name
        self.conditions = conditions
        self.counts = [ClassCounts() for _ in classes]
        self.waiting_bytes = [0] * len(classes)
        self.used_share_s = 0.0
        self.share = 0.0
        self._classes = classes
        self._seed = seed
        self._order = sorted(range(len(classes)), key=lambda index: -classes[index].priority)
        self._queues: list[deque[Waiting]] = [deque() for _ in classes]
        self._opened: dict[str, int] = {}

    def flow(self, topic: str, class_index: int, handle: Any = None) -> Flow:
        """A new connection. Its chance follows from seed, link, topic, and how many there were before."""
        number = self._opened[topic] = self._opened.get(topic, 0) + 1
        words = [self._seed, crc32(self.name.encode()), crc32(topic.encode()), number]
        return Flow(topic, class_index, handle, generator=np.random.default_rng(words))

    @property
    def is_idle(self) -> bool:
        """Whether nothing waits."""
        return not any(self._queues)

    def has_room(self, class_index: int, size: int) -> bool:
        """Whether a message fits; one that is larger than the whole queue fits while that is empty."""
        held = self.waiting_bytes[class_index]
        return not held or held + size <= self._classes[class_index].queue_bytes

    def offer(self, flow: Flow, item: Any, size: int, now_s: float) -> bool:
        """A message came. False: there is no room and its class is held; offer it again later."""
        index = flow.class_index
        counts = self.counts[index]
        fits = self.has_room(index, size)
        if not fits and self._classes[index].overflow is Overflow.HOLD:
            return False
        counts.offered += 1
        counts.offered_bytes += size
        if fits:
            self._queues[index].append(Waiting(flow, index, item, size, now_s, size))
            self.waiting_bytes[index] += size
            flow.on_way += 1
        else:
            counts.dropped += 1
        return True

    def refuse(self, flow: Flow, size: int) -> None:
        """A message that nobody can hold back does not fit: it is dropped."""
        counts = self.counts[flow.class_index]
        counts.offered += 1
        counts.offered_bytes += size
        counts.dropped += 1

    def head(self, now_s: float) -> Waiting | None:
        """What is sent now: the oldest of the most urgent class."""
        for index in self._order:
            queue = self._queues[index]
            if self._classes[index].discard_late:
                self._discard_late(index, now_s)
            if queue:
                return queue[0]
        return None

    def _discard_late(self, index: int, now_s: float) -> None:
        queue, deadline_s = self._queues[index], self._classes[index].deadline_s
        while queue and deadline_s is not None:
            first = queue[0]
            if first.left_bytes < first.size or now_s - first.entered_s <= deadline_s:
                return
            self._pop(index)
            first.flow.on_way -= 1
            self.counts[index].expired += 1

    def _pop(self, index: int) -> Waiting:
        waiting = self._queues[index].popleft()
        self.waiting_bytes[index] -= waiting.size
        return waiting

    def sent(self, waiting: Waiting, now_s: float) -> float | None:
        """The last byte of a message was sent. When it arrives; None: never."""
        flow, conditions = waiting.flow, self.conditions
        self._pop(waiting.class_index)
        if conditions.loss and flow.is_lost(conditions.loss):
            self.counts[waiting.class_index].lost += 1
            flow.on_way -= 1
            return None
        delay_s = conditions.delay_s
        if conditions.jitter_s:
            delay_s += flow.jitter_s(conditions.jitter_s)
        flow.last_s = max(flow.last_s, now_s + delay_s)
        return flow.last_s

    def arrived(self, waiting: Waiting, at_s: float) -> None:
        """A message has arrived."""
        index = waiting.class_index
        counts, deadline_s = self.counts[index], self._classes[index].deadline_s
        latency_s = at_s - waiting.entered_s
        waiting.flow.on_way -= 1
        counts.delivered += 1
        counts.delivered_bytes += waiting.size
        counts.latencies_s.append(latency_s)
        if deadline_s is not None and latency_s > deadline_s:
            counts.late += 1
