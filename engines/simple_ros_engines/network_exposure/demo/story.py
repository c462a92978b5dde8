"""What happens to the simulated network in the demo, and when. Pure.

First everything is served, then the maximizer begins. Then, again and again: the cell is loaded so that the shortest delays
cannot be given, it is loaded more, it has recovered. Which delays those are depends on what is asked for at that moment, so that
somebody is hit, whatever a policy has made of requests.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from simple_ros.msg.network_exposure_msgs import FlowQosArray
from simple_ros_engines.network_exposure.qci import qos_class

__all__ = ["Act", "Step", "Story"]

_PATIENCE = 20
"""An act ends after so many times its length, whatever has not happened."""
_CALM_S = 6.0
"""So long after the maximizer has done something it is done."""


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
        pace_s: An act lasts at least so long.

    Attributes:
        act: Now.
        rounds: How often the network has run short and recovered.
    """

    def __init__(self, topics: frozenset[str], pace_s: float) -> None:
        self.act = Act.SETTING_UP
        self.rounds = 0
        self._topics = topics
        self._pace_s = pace_s
        self._since_s = 0.0
        self._served: frozenset[str] = frozenset()
        self._delays: dict[str, float] = {}
        self._before: dict[str, float] = {}
        self._slowed: set[str] = set()
        self._eased_s: float | None = None

    def flows_are(self, message: FlowQosArray) -> None:
        """What the watcher says."""
        asked = {flow.topic.strip("/"): flow for flow in message.flows if flow.session_id}
        self._served = frozenset(
            topic for topic, flow in asked.items() if flow.state == "active" and flow.qci
        )
        rows = {topic: qos_class(flow.qci) for topic, flow in asked.items()}
        self._delays = {topic: row.delay_ms for topic, row in rows.items() if row is not None}

    def slowed(self, process: str, *, is_slowed: bool) -> None:
        """A process drives slower than it was made for, or does not any more."""
        (self._slowed.add if is_slowed else self._slowed.discard)(process)

    def eased(self, now_s: float) -> None:
        """The maximizer has made something of a topic; the last of them counts."""
        self._eased_s = now_s

    def tick(self, now_s: float) -> Step | None:
        """The next act, if it is time for it."""
        waited_s = now_s - self._since_s
        if self.act is not Act.SETTING_UP and waited_s < self._pace_s:
            return None
        is_late = self.act is not Act.SETTING_UP and waited_s >= _PATIENCE * self._pace_s
        step = self._next(is_late=is_late) if is_late or self._is_done(now_s) else None
        if step is not None:
            self.act, self._since_s = step.act, now_s
        return step

    def _is_done(self, now_s: float) -> bool:
        is_served = self._served >= self._topics
        match self.act:
            case Act.AT_EASE:
                is_calm = self._eased_s is not None and now_s - self._eased_s >= _CALM_S
                return is_calm and is_served
            case Act.RECOVERED:
                is_back = all(
                    self._delays.get(topic, before + 1) <= before
                    for topic, before in self._before.items()
                )
                return not self._slowed and is_served and is_back
            case _:
                return is_served

    def _next(self, *, is_late: bool) -> Step | None:
        match self.act:
            case Act.SETTING_UP:
                return Step(Act.AT_EASE, "all topics are served; the maximizer begins")
            case Act.AT_EASE | Act.RECOVERED:
                self._before = dict(self._delays)
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
