"""One direction of a carrier that several shaped links share: exact in time, event by event. SIMULATED; pure.

The resource blocks are divided among the links that have something to send: each gets its least share, the
rest evenly up to everyone's largest share, as a scheduler does with the ratios of TS 28.541 (rRMPolicyRatio).
A link sends one message after the other at ``share * rate``; a more urgent class interrupts a less urgent one
between any two bytes. Between events nothing changes, so that the result does not depend on how often
`SharedRadio.advance` is called.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import count
from typing import Any

from simple_ros_engines.simulator.shaper_queue import DirectionQueue, Flow, Waiting
from simple_ros_engines.simulator.shaper_settings import Conditions, TopicClass

__all__ = ["SharedRadio", "divided"]

_STALLED_BPS = 1.0
_ROUNDING_S = 1e-7


def divided(wants: Sequence[tuple[float, float]]) -> list[float]:
    """Shares of those who want some of a whole: least shares first, the rest evenly up to the largest.

    Args:
        wants: Least and largest share of each. Least shares of more than 1 together are scaled.
    """
    total = sum(low for low, _ in wants)
    scale = 1 / total if total > 1 else 1.0
    shares = [low * scale for low, _ in wants]
    rest = 1 - sum(shares)
    open_ones = [i for i, (_, high) in enumerate(wants) if shares[i] < high]
    while rest > 1e-12 and open_ones:
        each = rest / len(open_ones)
        for i in open_ones:
            taken = min(each, wants[i][1] - shares[i])
            shares[i] += taken
            rest -= taken
        open_ones = [i for i in open_ones if wants[i][1] - shares[i] > 1e-12]
    return shares


class SharedRadio:
    """Links in one direction.

    Args:
        links: Conditions by name.
        classes: All there are.
        seed: Of chance.
        direction: For the names of chance.
    """

    def __init__(
        self,
        links: Mapping[str, Conditions],
        classes: Sequence[TopicClass],
        seed: int,
        direction: str,
    ) -> None:
        self.queues = {
            name: DirectionQueue(f"{name}/{direction}", conditions, classes, seed)
            for name, conditions in links.items()
        }
        self._now_s = -math.inf
        self._in_flight: list[tuple[float, int, DirectionQueue, Waiting]] = []
        self._order = count()
        self._heads: list[tuple[DirectionQueue, Waiting, float]] | None = None

    def offer(self, link: str, flow: Flow, item: Any, size: int, now_s: float) -> bool:
        """A message came; see `DirectionQueue.offer`. Call `advance` first."""
        queue = self.queues[link]
        taken = queue.offer(flow, item, size, now_s)
        if taken:
            self._heads = None
        return taken

    def change(self, link: str, conditions: Conditions) -> None:
        """From now on a link is different. Call `advance` first."""
        self.queues[link].conditions = conditions
        self._heads = None

    def change_rate(self, link: str, rate_bps: float) -> None:
        """From now on a link would have this rate with all blocks. Call `advance` first."""
        self.change(link, replace(self.queues[link].conditions, rate_bps=rate_bps))

    def advance(self, now_s: float) -> list[tuple[Flow, Any]]:
        """Let time pass; what has arrived by now, in order."""
        self._now_s = max(self._now_s, now_s) if self._is_quiet() else self._now_s
        while True:
            heads = self._sending()
            soonest = self._soonest(heads)
            self._serve(heads, min(soonest, now_s) - self._now_s)
            self._now_s = max(self._now_s, min(soonest, now_s))
            if soonest > now_s or not heads:
                break
            self._finish(heads)
        self._now_s = max(self._now_s, now_s)
        return self._landed(now_s)

    def _is_quiet(self) -> bool:
        return all(queue.is_idle for queue in self.queues.values())

    def _sending(self) -> list[tuple[DirectionQueue, Waiting, float]]:
        """Which message each link sends now, and at how many bits per second."""
        if self._heads is None:
            busy = []
            for queue in self.queues.values():
                queue.share = 0.0
                head = queue.head(self._now_s)
                if head is not None:
                    busy.append((queue, head))
            limits = [(q.conditions.min_share, q.conditions.max_share) for q, _ in busy]
            self._heads = []
            for (queue, head), share in zip(busy, divided(limits), strict=True):
                queue.share = share
                rate = share * queue.conditions.rate_bps if share else 0.0
                self._heads.append((queue, head, rate))
        return self._heads

    def _soonest(self, heads: list[tuple[DirectionQueue, Waiting, float]]) -> float:
        """When the first of them has been sent."""
        times = [
            self._now_s + 8 * head.left_bytes / rate
            for _, head, rate in heads
            if rate >= _STALLED_BPS
        ]
        return min(times, default=math.inf)

    def _serve(self, heads: list[tuple[DirectionQueue, Waiting, float]], span_s: float) -> None:
        if span_s <= 0:
            return
        for queue, head, rate in heads:
            queue.used_share_s += queue.share * span_s
            if rate >= _STALLED_BPS:
                head.left_bytes = max(0.0, head.left_bytes - rate * span_s / 8)

    def _finish(self, heads: list[tuple[DirectionQueue, Waiting, float]]) -> None:
        """Take out what has been sent."""
        for queue, head, rate in heads:
            if rate >= _STALLED_BPS and 8 * head.left_bytes / rate <= _ROUNDING_S:
                at_s = queue.sent(head, self._now_s)
                if at_s is not None:
                    heapq.heappush(self._in_flight, (at_s, next(self._order), queue, head))
        self._heads = None

    def _landed(self, now_s: float) -> list[tuple[Flow, Any]]:
        landed = []
        while self._in_flight and self._in_flight[0][0] <= now_s:
            at_s, _, queue, waiting = heapq.heappop(self._in_flight)
            queue.arrived(waiting, at_s)
            landed.append((waiting.flow, waiting.item))
        return landed

    def next_event_s(self) -> float:
        """When something will have been sent or will arrive; infinite if nothing will."""
        landing = self._in_flight[0][0] if self._in_flight else math.inf
        return min(landing, self._soonest(self._sending()))
