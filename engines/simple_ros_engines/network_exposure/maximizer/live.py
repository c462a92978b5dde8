"""Topics as they are now, as a plant: knobs become messages to throttle, mapper and application; messages become what agents see."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import replace

from simple_ros.errors import SimpleRosError
from simple_ros.msg.network_exposure_msgs import (
    QosAdvice,
    Throttle,
    UniqueTopicFlows,
    UniqueTopicFlowStat,
    UniqueTopicFlowStats,
)
from simple_ros.msg.turtlesim_msgs import Mos
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher
from simple_ros.qos import LATCHED, QosProfile
from simple_ros_engines.network_exposure.maximizer.depletion import lowered
from simple_ros_engines.network_exposure.maximizer.knobs import START, Setting
from simple_ros_engines.network_exposure.maximizer.plant import Plant, Seen
from simple_ros_engines.network_exposure.maximizer.resource import TopicTraffic
from simple_ros_engines.network_exposure.maximizer.shortage import Patience, Shortage
from simple_ros_engines.network_exposure.maximizer.source_rate import SourceRate
from simple_ros_engines.network_exposure.mos.estimator import WORST
from simple_ros_engines.network_exposure.mos.judgements import Judge, Judgements
from simple_ros_engines.network_exposure.mos.node import MOS_TOPIC, judge_of

__all__ = ["LivePlant", "LiveTopics", "NotLive"]

_PAUSE_S = 15.0
_RELIABLE, _BEST_EFFORT = 1e-5, 1e-2
_SAME = 0.05
"""A rate that differs by less is the same: a budget that trembles about that of a class would ask for two in turn."""


class NotLive(SimpleRosError, RuntimeError):
    """The topics are not there any more, or the node has ended."""


class LiveTopics:
    """What relays, scores and the network say of topics, and what they are told.

    Args:
        node: Subscribes and advertises.
        probes: Whether a delay is tried on the topic itself, by the throttle; else it is the budget that is
            asked of the network.
        patience: When the network is short.
    """

    def __init__(self, node: NodeHandle, *, probes: bool, patience: Patience | None = None) -> None:
        self.probes = probes
        self.ended = asyncio.Event()
        self._node = node
        self._judgements = Judgements()
        self._automatic: dict[str, tuple[str, ...]] = {}
        self._human: dict[str, tuple[str, ...]] = {}
        self._stats: dict[str, UniqueTopicFlowStat] = {}
        self._full: dict[str, TopicTraffic] = {}
        self._rates: dict[str, SourceRate] = {}
        self._errors: dict[str, float] = {}
        self._shortage = Shortage(node, lambda: self.groups, self._tell, patience)
        self._period_s = 0.0
        self._now: dict[str, Setting] = {}
        self._lowered: dict[str, Setting] = {}

    async def open(self) -> None:
        """Subscribe and advertise."""
        node, deep = self._node, QosProfile(depth=100)
        self._throttles: Publisher[Throttle] = await node.advertise("/throttle", Throttle, qos=deep)
        self._advice: Publisher[QosAdvice] = await node.advertise(
            "/qos_advice", QosAdvice, qos=deep
        )
        await node.subscribe("/unique_network_flow", UniqueTopicFlows, self._flows, qos=LATCHED)
        await node.subscribe("/unique_network_flow_stats", UniqueTopicFlowStats, self._came)
        await node.subscribe(MOS_TOPIC, Mos, self._score)
        await self._shortage.open()

    @property
    def groups(self) -> dict[str, tuple[str, ...]]:
        """Processes that are judged and whose topics are relayed and flow; a topic is in one only."""
        ready: dict[str, tuple[str, ...]] = {}
        taken: set[str] = set()
        # A program knows what its process is made of; people's groups count where no program says.
        for known in (self._automatic, self._human):
            for group, topics in known.items():
                if (
                    group not in ready
                    and topics
                    and all(topic in self._full and topic not in taken for topic in topics)
                ):
                    ready[group] = topics
                    taken.update(topics)
        return ready

    def traffic(self, topic: str) -> TopicTraffic:
        """What a topic sends when nothing is left out."""
        return self._full[topic]

    async def advance(self, settings: Mapping[str, Setting], period_s: float) -> dict[str, Seen]:
        """Set the knobs, wait, look.

        Raises:
            NotLive: The node has ended.
        """
        self._now = dict(settings)
        self._period_s = period_s
        self._shortage.tick(asyncio.get_running_loop().time())
        self._tell()
        try:
            async with asyncio.timeout(period_s):
                await self.ended.wait()
        except TimeoutError:
            return {topic: self._look(topic, settings[topic]) for topic in settings}
        raise NotLive("the maximizer's node has ended")

    def release(self) -> None:
        """Put everything back: no throttle, no advice, own speed."""
        self._now = dict.fromkeys(self._now, START)
        self._shortage.release()
        self._tell()

    # -- what it is told ---------------------------------------------------------------------------

    def _flows(self, message: UniqueTopicFlows) -> None:
        for flow in message.flows:
            self._errors[flow.topic.lstrip("/")] = _RELIABLE if flow.is_reliable else _BEST_EFFORT

    def _came(self, message: UniqueTopicFlowStats) -> None:
        # When it was counted, not when it came.
        stamp_s = message.header.stamp.ToNanoseconds() / 1e9
        for stat in message.stats:
            topic = stat.topic.lstrip("/")
            self._stats[topic] = stat
            rate_hz = self._rates.setdefault(topic, SourceRate()).counted(
                stat.num_messages + stat.throttled + stat.delayed, stamp_s
            )
            if not (stat.drop_every_nth or stat.delay_ms or stat.message_delay):
                rate_hz = stat.window_rate
            elif topic not in self._full:
                rate_hz = rate_hz or stat.window_rate
            known = self._full.get(topic)
            if known is not None and abs(rate_hz - known.rate_hz) <= _SAME * known.rate_hz:
                rate_hz = known.rate_hz
            if rate_hz > 0 and stat.window_rate > 0:
                size = stat.window_bandwidth / stat.window_rate
                errors = self._errors.get(topic, _RELIABLE)
                self._full[topic] = TopicTraffic(rate_hz, size, errors)

    def _score(self, message: Mos) -> None:
        judge = judge_of(message)
        if judge is None:
            return
        topics = tuple(topic.lstrip("/") for topic in message.topics)
        loop = asyncio.get_running_loop()
        known = self._automatic if judge is Judge.AUTOMATIC else self._human
        if not self._judgements.came(message.group, topics, message.score, judge, loop.time()):
            return
        if topics:
            known[message.group] = topics
        else:
            known.pop(message.group, None)

    # -- what it says ------------------------------------------------------------------------------

    def _tell(self) -> None:
        for group, topics in self.groups.items():
            level = self._shortage.level(group)
            for topic in topics:
                self._tell_topic(topic, self._in_force(topic, level))
            wanted = self._now.get(topics[-1], START)
            self._shortage.ask(group, wanted.speed_factor, self._period_s)

    def _in_force(self, topic: str, level: int) -> Setting:
        """The setting, with a longer delay while the network is short: as long as was found when that began."""
        setting = self._now.get(topic, START)
        if not level:
            self._lowered.pop(topic, None)
            return setting
        if topic not in self._lowered:
            self._lowered[topic] = lowered(self._full[topic], setting)
        return self._lowered[topic]

    def _tell_topic(self, topic: str, setting: Setting) -> None:
        budget_ms = setting.delay_ms(self._full[topic].rate_hz)
        # It is said again each period; who trains may think for a while between two.
        valid_s = _PAUSE_S + 3 * self._period_s
        throttle = Throttle(topic=topic, drop_every_nth=setting.drop_every_nth, valid_s=valid_s)
        advice = QosAdvice(topic=topic, clear=True)
        if self.probes:
            throttle.delay_ms = budget_ms
        elif budget_ms:
            advice = QosAdvice(topic=topic, latency_budget_ms=budget_ms, valid_s=valid_s)
        self._throttles.publish(throttle)
        self._advice.publish(advice)

    def _look(self, topic: str, setting: Setting) -> Seen:
        stat = self._stats.get(topic, UniqueTopicFlowStat())
        judged = self._judgements.of(topic, asyncio.get_running_loop().time())
        group = next((name for name, topics in self.groups.items() if topic in topics), "")
        seen = Seen(
            stat.window_rate,
            stat.window_bandwidth,
            stat.window_jitter,
            # Who is not judged any more may be in any state.
            WORST if judged is None else judged.score,
            setting,
        )
        return replace(seen, is_downgraded=self._shortage.level(group) > 0)


class LivePlant(Plant):
    """Live topics for an environment that is stepped in another thread than the node's.

    Args:
        topics: Of the node.
        loop: The node's.
        period_s: A decision stands so long.
    """

    def __init__(
        self, topics: LiveTopics, loop: asyncio.AbstractEventLoop, period_s: float = 4.0
    ) -> None:
        self._topics, self._loop, self._period_s = topics, loop, period_s
        self._groups = topics.groups

    @property
    def groups(self) -> Mapping[str, tuple[str, ...]]:
        """Processes as they were when it was made."""
        return self._groups

    def traffic(self, topic: str) -> TopicTraffic:
        """What a topic sends when nothing is left out."""
        return self._topics.traffic(topic)

    def advance(self, settings: Mapping[str, Setting]) -> dict[str, Seen]:
        """Set the knobs, wait for a decision period, look.

        Raises:
            NotLive: The node has ended.
        """
        waiting = self._topics.advance(settings, self._period_s)
        return asyncio.run_coroutine_threadsafe(waiting, self._loop).result()
