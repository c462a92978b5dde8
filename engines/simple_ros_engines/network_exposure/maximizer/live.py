"""Topics as they are now, as a plant: knobs become messages to throttle, mapper and application; messages become what agents see."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import replace

from simple_ros.errors import SimpleRosError
from simple_ros.msg.network_exposure_msgs import (
    FlowQosArray,
    QosAdvice,
    QosNotification,
    Throttle,
    UniqueTopicFlows,
    UniqueTopicFlowStat,
    UniqueTopicFlowStats,
)
from simple_ros.msg.turtlesim_msgs import AdaptationRequest, Mos
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher
from simple_ros.qos import LATCHED, QosProfile
from simple_ros_engines.network_exposure.maximizer.depletion import Depletion, Measure
from simple_ros_engines.network_exposure.maximizer.knobs import START, Setting
from simple_ros_engines.network_exposure.maximizer.plant import Plant, Seen
from simple_ros_engines.network_exposure.maximizer.resource import TopicTraffic
from simple_ros_engines.network_exposure.mos.estimator import WORST
from simple_ros_engines.network_exposure.mos.judgements import Judge, Judgements
from simple_ros_engines.network_exposure.mos.node import MOS_TOPIC, judge_of

__all__ = ["LivePlant", "LiveTopics", "NotLive"]

ADAPTATION_TOPIC = "/application_adaptation_request"
_SLOWED = 0.5
_REFUSED = ("failed", "degraded")
_GIVEN = "active"
_RELIABLE, _BEST_EFFORT = 1e-5, 1e-2


class NotLive(SimpleRosError, RuntimeError):
    """The topics are not there any more, or the node has ended."""


class LiveTopics:
    """What relays, scores and the network say of topics, and what they are told.

    Args:
        node: Subscribes and advertises.
        probes: Whether a delay is tried on the topic itself, by the throttle; else it is the budget that is
            asked of the network.
    """

    def __init__(self, node: NodeHandle, *, probes: bool) -> None:
        self.probes = probes
        self.ended = asyncio.Event()
        self._node = node
        self._judgements = Judgements()
        self._automatic: dict[str, tuple[str, ...]] = {}
        self._human: dict[str, tuple[str, ...]] = {}
        self._stats: dict[str, UniqueTopicFlowStat] = {}
        self._full: dict[str, TopicTraffic] = {}
        self._errors: dict[str, float] = {}
        self._depletion: dict[str, Depletion] = {}
        self._now: dict[str, Setting] = {}
        self._told: dict[str, Setting] = {}

    async def open(self) -> None:
        """Subscribe and advertise."""
        node, deep = self._node, QosProfile(depth=100)
        self._throttles: Publisher[Throttle] = await node.advertise("/throttle", Throttle, qos=deep)
        self._advice: Publisher[QosAdvice] = await node.advertise(
            "/qos_advice", QosAdvice, qos=deep
        )
        self._requests: Publisher[AdaptationRequest] = await node.advertise(
            ADAPTATION_TOPIC, AdaptationRequest, qos=QosProfile(depth=10)
        )
        await node.subscribe("/unique_network_flow", UniqueTopicFlows, self._flows, qos=LATCHED)
        await node.subscribe("/unique_network_flow_stats", UniqueTopicFlowStats, self._came)
        await node.subscribe(MOS_TOPIC, Mos, self._score)
        await node.subscribe("/network_flow_state", FlowQosArray, self._states, qos=LATCHED)
        await node.subscribe("/qos_notifications", QosNotification, self._notified)

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
        now_s = asyncio.get_running_loop().time()
        for group, depletion in self._depletion.items():
            self._measure(group, depletion.tick(now_s), "the network serves what is asked for")
        self._tell()
        try:
            await asyncio.wait_for(self.ended.wait(), period_s)
        except TimeoutError:
            return {topic: self._look(topic, settings[topic]) for topic in settings}
        raise NotLive("the maximizer's node has ended")

    def release(self) -> None:
        """Put everything back: no throttle, no advice, own speed."""
        self._now = dict.fromkeys(self._now, START)
        for group, depletion in self._depletion.items():
            if depletion.level == 2:
                self._ask(group, 1.0, 1.0, "the maximizer ends")
            depletion.level = 0
        self._tell()

    # -- what it is told ---------------------------------------------------------------------------

    def _flows(self, message: UniqueTopicFlows) -> None:
        for flow in message.flows:
            self._errors[flow.topic.lstrip("/")] = _RELIABLE if flow.is_reliable else _BEST_EFFORT

    def _came(self, message: UniqueTopicFlowStats) -> None:
        for stat in message.stats:
            topic = stat.topic.lstrip("/")
            self._stats[topic] = stat
            is_whole = not (stat.drop_every_nth or stat.delay_ms or stat.message_delay)
            if stat.window_rate > 0 and (is_whole or topic not in self._full):
                size = stat.window_bandwidth / stat.window_rate
                errors = self._errors.get(topic, _RELIABLE)
                self._full[topic] = TopicTraffic(stat.window_rate, size, errors)

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

    def _notified(self, message: QosNotification) -> None:
        topic, now_s = message.topic.lstrip("/"), asyncio.get_running_loop().time()
        group = self._group_of(topic)
        if not group:
            return
        depletion = self._depletion.setdefault(group, Depletion())
        if message.event in (QosNotification.DOWNGRADED, QosNotification.TERMINATED):
            self._measure(group, depletion.downgraded(topic, now_s), message.detail)
        elif message.event == QosNotification.RECOVERED:
            self._measure(group, depletion.recovered(topic, now_s), message.detail)
        elif message.event == QosNotification.GRANTED:
            self._measure(group, depletion.granted(topic, now_s), message.detail)

    def _states(self, message: FlowQosArray) -> None:
        """That a request is refused is no notification: only its state says so."""
        now_s = asyncio.get_running_loop().time()
        for flow in message.flows:
            topic = flow.topic.lstrip("/")
            group = self._group_of(topic)
            depletion = self._depletion.get(group)
            if depletion is None or not depletion.level:
                continue
            if flow.state in _REFUSED:
                self._measure(group, depletion.downgraded(topic, now_s), flow.detail)
            elif flow.state == _GIVEN:
                self._measure(group, depletion.granted(topic, now_s), flow.detail)

    def _group_of(self, topic: str) -> str:
        """Name of the process of a topic; empty if nobody judges it."""
        return next((name for name, topics in self.groups.items() if topic in topics), "")

    def _measure(self, group: str, measure: Measure | None, why: str) -> None:
        if measure is None:
            return
        self._tell()
        if measure in (Measure.ADAPT, Measure.RESTORE):
            factor = _SLOWED if measure is Measure.ADAPT else 1.0
            self._ask(group, factor, factor, why or measure.value)

    # -- what it says ------------------------------------------------------------------------------

    def _tell(self) -> None:
        groups = self.groups
        for group, topics in groups.items():
            level = self._depletion.setdefault(group, Depletion()).level
            for topic in topics:
                self._tell_topic(topic, self._in_force(topic, level))
            last = topics[-1]
            before = self._told.get(group, START).speed
            wanted = self._now.get(last, START)
            if wanted.speed != before and level < 2:
                self._ask(group, wanted.speed_factor, 0.0, "the maximizer's policy")
            self._told[group] = wanted

    def _in_force(self, topic: str, level: int) -> Setting:
        """The setting, with a longer delay while the network is short."""
        setting = self._now.get(topic, START)
        return setting.moved((1, 0, 0)) if level else setting

    def _tell_topic(self, topic: str, setting: Setting) -> None:
        budget_ms = setting.delay_ms(self._full[topic].rate_hz)
        throttle = Throttle(topic=topic, drop_every_nth=setting.drop_every_nth)
        advice = QosAdvice(topic=topic, clear=True)
        if self.probes:
            throttle.delay_ms = budget_ms
        elif budget_ms:
            advice = QosAdvice(topic=topic, latency_budget_ms=budget_ms)
        self._throttles.publish(throttle)
        self._advice.publish(advice)

    def _ask(self, group: str, speed: float, rate: float, why: str) -> None:
        request = AdaptationRequest(group=group, speed_factor=speed, rate_factor=rate, reason=why)
        request.topics.extend((self._human | self._automatic).get(group, ()))
        request.header.stamp.GetCurrentTime()
        self._requests.publish(request)

    def _look(self, topic: str, setting: Setting) -> Seen:
        stat = self._stats.get(topic, UniqueTopicFlowStat())
        judged = self._judgements.of(topic, asyncio.get_running_loop().time())
        group = self._group_of(topic)
        seen = Seen(
            stat.window_rate,
            stat.window_bandwidth,
            stat.window_jitter,
            # Who is not judged any more may be in any state.
            WORST if judged is None else judged.score,
            setting,
        )
        return replace(seen, is_downgraded=self._depletion.get(group, Depletion()).level > 0)


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
