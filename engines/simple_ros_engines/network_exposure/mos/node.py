"""The node of scores: a page on which a person groups relayed topics and gives stars, published on ``/MOS``."""

from __future__ import annotations

import logging
import time
from pathlib import Path
from typing import Any, ClassVar

from simple_ros.engine import Engine
from simple_ros.msg.network_exposure_msgs import (
    FlowQos,
    FlowQosArray,
    UniqueTopicFlows,
    UniqueTopicFlowStats,
)
from simple_ros.msg.turtlesim_msgs import AdaptationRequest, Mos
from simple_ros.net.addresses import address_of
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher
from simple_ros.qos import LATCHED, QosProfile
from simple_ros_engines.network_exposure.mos.board import MOST_GROUPS, Board
from simple_ros_engines.network_exposure.mos.judgements import Judge, Judgements
from simple_ros_engines.network_exposure.mos.page_server import Feed, PageServer
from simple_ros_engines.network_exposure.turtlesim.adaptation import (
    ADAPTATION_TOPIC,
    Adaptations,
)

__all__ = ["MOS_TOPIC", "MeanOpinionScoring", "judge_of"]

logger = logging.getLogger(__name__)

MOS_TOPIC = "/MOS"
REPEAT_S = 1.0
_WEB = Path(__file__).parent / "web"
_JUDGES = {Mos.HUMAN: Judge.HUMAN, Mos.AUTOMATIC: Judge.AUTOMATIC}


def judge_of(message: Mos) -> Judge | None:
    """Who gave a score; None if the message does not say."""
    return _JUDGES.get(message.identifier)


class MeanOpinionScoring(Engine):
    """Asks people how well it goes.

    Scores are said again each second while they stand, and taken back with a score of 0. Parameters of its
    node: ``page`` (``[HOST:]PORT`` of the page; port 0 takes any), ``valid_s`` (stars count so long after the
    click; 0 until they are taken back).

    Attributes:
        board: Groups and stars.
        url: Of the page.
    """

    node_name: ClassVar[str] = "mean_opinion_scoring"
    summary: ClassVar[str] = "A page to group relayed topics and give stars, published on /MOS."

    def __init__(self) -> None:
        self.board = Board()
        self.judgements = Judgements()
        self._flows: dict[str, list[str]] = {}
        self._served: dict[str, str] = {}
        self._is_simulated = False
        self._asked: dict[str, Adaptations] = {}
        self._told: set[str] = set()
        self._valid_s = 0.0
        self._publisher: Publisher[Mos] | None = None
        self._page = PageServer(_WEB, self._feed, self._command)

    @property
    def url(self) -> str:
        """Where the page is, while there is one."""
        return self._page.url

    async def run(self, node: NodeHandle) -> None:
        """Work until cancelled or the node ends.

        Raises:
            ConfigError: ``page`` is no address.
        """
        host, port = address_of(
            str(await node.declare_parameter("~page", "127.0.0.1:8090", read_only=True)), "~page"
        )
        self._valid_s = float(await node.declare_parameter("~valid_s", 0.0, minimum=0))
        node.on_parameter_changed("~valid_s", self._set_valid)
        await node.subscribe("unique_network_flow", UniqueTopicFlows, self._flows_came, qos=LATCHED)
        await node.subscribe("unique_network_flow_stats", UniqueTopicFlowStats, self._stats_came)
        await node.subscribe(MOS_TOPIC, Mos, self._score_came)
        await node.subscribe("network_flow_state", FlowQosArray, self._states_came, qos=LATCHED)
        await node.subscribe(ADAPTATION_TOPIC, AdaptationRequest, self._asked_to_adapt)
        self._publisher = await node.advertise(MOS_TOPIC, Mos, qos=QosProfile(depth=100))
        node.create_timer(REPEAT_S, lambda _: self.publish())
        async with self._page.listening(host, port) as url:
            if url:
                # With port 0 nobody else knows.
                print(f"scores are given at {url}", flush=True)
            await node.spin()

    def _set_valid(self, value: Any) -> None:
        self._valid_s = float(value)

    # -- what it hears -----------------------------------------------------------------------------

    def _flows_came(self, message: UniqueTopicFlows) -> None:
        self._flows[message.relay] = [flow.topic for flow in message.flows]
        self.board.flows_are({topic for topics in self._flows.values() for topic in topics})

    def _stats_came(self, message: UniqueTopicFlowStats) -> None:
        for stat in message.stats:
            self.board.measured(
                stat.topic, stat.window_rate, stat.window_bandwidth, stat.window_jitter
            )

    def _states_came(self, message: FlowQosArray) -> None:
        self._is_simulated = message.is_simulated
        self._served = {}
        # A topic has a flow for each subscriber: the one that fares worst is shown.
        for flow in sorted(message.flows, key=lambda flow: flow.state in _TROUBLE):
            self._served[flow.topic.lstrip("/")] = _served(flow)

    def _asked_to_adapt(self, message: AdaptationRequest) -> None:
        if message.group not in self._asked and len(self._asked) >= MOST_GROUPS:
            return
        self._asked.setdefault(message.group, Adaptations()).came(
            message.requester,
            message.speed_factor,
            message.rate_factor,
            message.valid_s,
            time.monotonic(),
            message.reason,
        )

    def _score_came(self, message: Mos) -> None:
        judge = judge_of(message)
        if judge is not None:
            self.judgements.came(
                message.group, message.topics, message.score, judge, time.monotonic()
            )

    # -- what it says ------------------------------------------------------------------------------

    def publish(self) -> None:
        """Say all scores that stand, and take back those that do not any more."""
        if self._publisher is None:
            return
        now_s = time.monotonic()
        for name, group in self.board.groups.items():
            if self._valid_s and group.stars and now_s - group.rated_s > self._valid_s:
                group.stars = 0.0
            if group.stars:
                self._publisher.publish(_score(name, group.topics, group.stars))
        standing = {name for name, group in self.board.groups.items() if group.stars}
        for name in self._told - standing:
            self._publisher.publish(_score(name, (), 0.0))
        self._told = standing

    def _command(self, said: dict[str, Any]) -> str:
        done = self.board.command(said, time.monotonic())
        self.publish()
        return done

    def _feed(self) -> Feed:
        return self.state

    def state(self) -> dict[str, Any]:
        """What the page shows."""
        board, now_s = self.board, time.monotonic()
        counting = {topic: self.judgements.of(topic, now_s) for topic in board.topics}
        return {
            "simulated": self._is_simulated,
            "topics": [
                {
                    "name": topic,
                    "rate": round(known.rate_hz, 2),
                    "bandwidth": round(known.bytes_per_s),
                    "jitter_ms": round(1000 * known.jitter_s, 2),
                    "flowing": known.is_flowing,
                    "network": self._served.get(topic.lstrip("/"), ""),
                    "score": None if judged is None else round(judged.score, 2),
                    "judge": None if judged is None else judged.judge.value,
                }
                for topic, known in sorted(board.topics.items())
                for judged in (counting[topic],)
            ],
            "groups": [
                {"name": name, "topics": list(group.topics), "stars": group.stars}
                for name, group in sorted(board.groups.items())
            ],
            "asked": [
                {
                    "group": group or "everybody",
                    "speed": one.speed(now_s),
                    "rate": one.rate(now_s),
                    "reason": one.reason(now_s),
                }
                for group, one in sorted(self._asked.items())
                if (one.speed(now_s), one.rate(now_s)) != (1.0, 1.0)
            ],
            "scores": [
                {"group": one.group, "judge": one.judge.value, "score": round(one.score, 2)}
                for one in sorted(
                    self.judgements.live(now_s), key=lambda one: (one.group, one.judge.value)
                )
            ],
        }


_TROUBLE = ("failed", "degraded")


def _served(flow: FlowQos) -> str:
    """What the network makes of a flow, in few words."""
    if flow.state == "degraded" and flow.applied_qci:
        return f"QCI {flow.applied_qci} instead of {flow.qci}"
    if flow.state == "active":
        return f"QCI {flow.qci}"
    return flow.state


def _score(group: str, topics: tuple[str, ...], score: float) -> Mos:
    message = Mos(identifier=Mos.HUMAN, group=group, topics=topics, score=score)
    message.header.stamp.GetCurrentTime()
    return message
