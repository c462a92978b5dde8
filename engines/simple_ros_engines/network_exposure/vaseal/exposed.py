"""What applications expose to the network: how well each process goes, what it is asked for, what its flows get. Pure.

This is the event monitoring of the VASEAL Service Server.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from simple_ros_engines.network_exposure.mos.judgements import Judge, Judgements
from simple_ros_engines.network_exposure.turtlesim.adaptation import Adaptations, is_meant

__all__ = ["Exposed", "FlowState"]


@dataclass(frozen=True, slots=True)
class FlowState:
    """What a flow was asked for and gets.

    Attributes:
        topic: As relayed.
        state: In a word.
        qci: That was asked for; 0 for none.
        applied_qci: That is given; 0 if nobody says.
    """

    topic: str
    state: str
    qci: int = 0
    applied_qci: int = 0


class Exposed:
    """The processes that programs judge. A person's score of their topics goes before the program's."""

    def __init__(self) -> None:
        self._judgements = Judgements()
        self._asked: dict[str, Adaptations] = {}
        self._flows: dict[str, FlowState] = {}

    def scored(
        self, group: str, topics: Iterable[str], score: float, judge: Judge, now_s: float
    ) -> None:
        """A score was given."""
        named = tuple(topic.strip("/") for topic in topics)
        self._judgements.came(group, named, score, judge, now_s)

    def flows_are(self, flows: Iterable[FlowState]) -> None:
        """A watcher tells its flows."""
        for flow in flows:
            self._flows[flow.topic] = flow

    def asked(
        self,
        group: str,
        topics: tuple[str, ...],
        requester: str,
        factors: tuple[float, float],
        valid_s: float,
        now_s: float,
    ) -> None:
        """Applications are asked for a share of their speed and rate."""
        for known, own in self.groups(now_s).items():
            if is_meant(group, topics, known, own):
                self._asked.setdefault(known, Adaptations()).came(
                    requester, *factors, valid_s, now_s
                )

    def groups(self, now_s: float) -> dict[str, tuple[str, ...]]:
        """Topics by process."""
        return {
            one.group: one.topics
            for one in self._judgements.live(now_s)
            if one.judge is Judge.AUTOMATIC
        }

    def reports(self, now_s: float, valid_s: float) -> dict[str, dict[str, Any]]:
        """What is told to the network, by process.

        Args:
            now_s: The time.
            valid_s: Counts so long.
        """
        return {
            group: self._report(group, topics, now_s) | {"validFor": valid_s}
            for group, topics in self.groups(now_s).items()
        }

    def _report(self, group: str, topics: tuple[str, ...], now_s: float) -> dict[str, Any]:
        asked = self._asked.get(group, Adaptations())
        report: dict[str, Any] = {
            "group": group,
            "topics": list(topics),
            "speedFactor": asked.speed(now_s),
            "rateFactor": asked.rate(now_s),
            "flows": [
                {
                    "topic": flow.topic,
                    "state": flow.state,
                    "qci": flow.qci,
                    "appliedQci": flow.applied_qci,
                }
                for topic in topics
                if (flow := self._flows.get(topic)) is not None
            ],
        }
        judged = [one for topic in topics if (one := self._judgements.of(topic, now_s)) is not None]
        if judged:
            worst = min(judged, key=lambda one: one.score)
            report |= {"score": round(worst.score, 2), "judge": worst.judge.value}
        return report
