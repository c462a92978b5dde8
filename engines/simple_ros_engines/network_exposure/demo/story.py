"""What happens to the simulated network in the demo, and when. Pure.

First everything is served, then the maximizer begins. Then, again and again: the cell is loaded so that the shortest delays
cannot be given, it is loaded more, it has recovered. Which delays those are depends on what is asked for at that moment, so that
somebody is hit, whatever a policy has made of requests.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from simple_ros.msg.network_exposure_msgs import FlowQosArray
from simple_ros_engines.network_exposure.qci import qos_class

__all__ = ["Act", "Pacing", "Step", "Story"]

_PATIENCE = 20
"""An act ends after so many times its length, whatever has not happened."""
_GOOD, _GOOD_WITHIN_S = 4.3, 20.0
"""The maximizer takes all back when it meets a bad score: who has not got on its circle yet has one."""
_SAME = 1.15
"""A need that is at most so many times as long is the same: rates are measured."""
WINDOW_S = 2.0
"""What the relay measures is about so long; no window is shorter."""


@dataclass(frozen=True, slots=True)
class Pacing:
    """Times that go with the length of an act: who hurries must not wait longer for a step than an act lasts.

    Attributes:
        pace_s: An act lasts at least so long.
        setup_s: The network takes so long for a bearer.
    """

    pace_s: float = 15.0
    setup_s: float = 2.0

    @property
    def dwell_s(self) -> float:
        """Something else must be needed for so long before it is asked for."""
        return min(5.0, max(1.0, self.pace_s / 3))

    @property
    def period_s(self) -> float:
        """Between two decisions of the maximizer."""
        return min(1.0, max(0.25, self.pace_s / 15))

    @property
    def settle_s(self) -> float:
        """A lower request has so long before a further downgrade counts."""
        return self.dwell_s + self.setup_s + 1.0

    @property
    def patience_s(self) -> float:
        """A lower request may stay so long without an answer; so long all is served before more is tried."""
        return max(2 * self.pace_s, WINDOW_S + self.settle_s + 1.0)

    @property
    def calm_s(self) -> float:
        """So long after the maximizer has done something it is done."""
        return self.dwell_s + WINDOW_S


class Act(Enum):
    """Where the story is."""

    SETTING_UP = "setting up"
    AT_EASE = "at ease"
    SHORT = "short"
    SHORTER = "shorter"
    RECOVERED = "recovered"


@dataclass(frozen=True, slots=True)
class Step:
    """What to do now.

    Attributes:
        act: That begins.
        text: In words.
        least_delay_ms: Shortest delay budget that the network gives from now on; 0 for any.
    """

    act: Act
    text: str
    least_delay_ms: float = 0.0


class Story:
    """The story.

    Args:
        topics: That must be served before it begins, as relayed.
        pacing: How long things take.

    Attributes:
        act: Now.
        rounds: How often the network has run short and recovered.
    """

    def __init__(self, topics: frozenset[str], pacing: Pacing) -> None:
        self.act = Act.SETTING_UP
        self.rounds = 0
        self._topics = topics
        self._pacing = pacing
        self._since_s = 0.0
        self._served: frozenset[str] = frozenset()
        self._delays: dict[str, float] = {}
        self._needs: dict[str, float] = {}
        self._before: dict[str, tuple[float, float]] = {}
        self._slowed: set[str] = set()
        self._scores: dict[str, float] = {}
        self._served_s: float | None = None
        self._eased_s: float | None = None

    def flows_are(self, message: FlowQosArray) -> None:
        """What the watcher says."""
        asked = {flow.topic.strip("/"): flow for flow in message.flows if flow.session_id}
        self._served = frozenset(
            topic for topic, flow in asked.items() if flow.state == "active" and flow.qci
        )
        self._needs = {topic: flow.delay_budget_ms for topic, flow in asked.items()}
        rows = {topic: qos_class(flow.qci) for topic, flow in asked.items()}
        self._delays = {topic: row.delay_ms for topic, row in rows.items() if row is not None}

    def slowed(self, process: str, *, is_slowed: bool) -> None:
        """A process drives slower than it was made for, or does not any more."""
        (self._slowed.add if is_slowed else self._slowed.discard)(process)

    def scored(self, process: str, score: float) -> None:
        """How well a process does now."""
        self._scores[process] = score

    def eased(self, now_s: float) -> None:
        """The maximizer has made something of a topic; the last of them counts."""
        self._eased_s = now_s

    def tick(self, now_s: float) -> Step | None:
        """The next act, if it is time for it."""
        waited_s = now_s - self._since_s
        if self.act is not Act.SETTING_UP and waited_s < self._pacing.pace_s:
            return None
        is_late = self.act is not Act.SETTING_UP and waited_s >= _PATIENCE * self._pacing.pace_s
        step = self._next(is_late=is_late) if is_late or self._is_done(now_s) else None
        if step is not None:
            self.act, self._since_s = step.act, now_s
        return step

    def _is_done(self, now_s: float) -> bool:
        is_served = self._served >= self._topics
        match self.act:
            case Act.AT_EASE:
                is_calm = self._eased_s is not None and now_s - self._eased_s >= self._pacing.calm_s
                return is_calm and is_served
            case Act.RECOVERED:
                return not self._slowed and is_served and all(map(self._is_back, self._before))
            case Act.SETTING_UP:
                return is_served and self._is_good(now_s)
            case _:
                return is_served

    def _is_good(self, now_s: float) -> bool:
        """Whether all scores are good, or no better ones can be hoped for."""
        if self._served_s is None:
            self._served_s = now_s
        is_good = all(score >= _GOOD for score in self._scores.values())
        return is_good or now_s - self._served_s >= _GOOD_WITHIN_S

    def _is_back(self, topic: str) -> bool:
        """Whether a topic asks for as much as before, by class or by need.

        The class may have been one for rates that were not steady yet; the need that of a request which served a longer one, too.
        """
        (delay_ms, need_ms), (least_ms, before_ms) = self._asks(topic), self._before[topic]
        return delay_ms <= least_ms or need_ms <= _SAME * before_ms

    def _asks(self, topic: str) -> tuple[float, float]:
        return self._delays.get(topic, math.inf), self._needs.get(topic, math.inf)

    def _next(self, *, is_late: bool) -> Step | None:
        match self.act:
            case Act.SETTING_UP:
                return Step(Act.AT_EASE, "all topics are served; the maximizer begins")
            case Act.AT_EASE | Act.RECOVERED:
                self._before = {topic: self._asks(topic) for topic in self._needs}
                self.rounds += self.act is Act.RECOVERED
                return self._loaded(Act.SHORT, "the cell is loaded")
            case Act.SHORTER if not self._slowed and not is_late:
                # Another process was hit than the first time.
                return self._loaded(Act.SHORTER, "the cell is loaded still more")
            case Act.SHORT:
                return self._loaded(Act.SHORTER, "the cell is loaded even more")
        return Step(Act.RECOVERED, "the cell has recovered: all classes are given again")

    def _loaded(self, act: Act, text: str) -> Step:
        # The tightest class that is asked for: who has it can do with another.
        least_ms = min(self._delays.values(), default=0.0) + 1.0
        return Step(
            act, f"{text}: no class with a delay below {least_ms:g} ms is given now", least_ms
        )
