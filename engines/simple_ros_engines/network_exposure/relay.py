"""The Unique Flow Topic Relay: tagged topics, each on connections of its own that the network can tell apart."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Sequence
from typing import ClassVar

from simple_ros.engine import Engine
from simple_ros.errors import ConfigError, MasterUnavailable, SimpleRosError
from simple_ros.graph_source import fetch_graph
from simple_ros.msg.network_exposure_msgs import (
    FlowQosArray,
    Throttle,
    TunnelSelect,
    UniqueTopicFlow,
    UniqueTopicFlows,
    UniqueTopicFlowStats,
)
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher
from simple_ros.qos import Durability, QosProfile
from simple_ros_engines.network_exposure.offers import offered_by
from simple_ros_engines.network_exposure.relay_plan import PlanSettings, RelayPlan, Wanted, plan
from simple_ros_engines.network_exposure.relayed import RelayedTopic, TopicSettings
from simple_ros_engines.network_exposure.reorder import DropLate, HoldBack
from simple_ros_engines.network_exposure.tags import Role, TagRules
from simple_ros_engines.network_exposure.throttle import ThrottleSettings
from simple_ros_engines.network_exposure.tunnel_end import TunnelEnd

__all__ = ["FLOWS_TOPIC", "STATS_TOPIC", "FlowRelay"]

logger = logging.getLogger(__name__)

FLOWS_TOPIC = "/unique_network_flow"
STATS_TOPIC = "/unique_network_flow_stats"
QOS_TOPIC = "/network_flow_state"
THROTTLE_TOPIC = "/throttle"
SELECT_TOPIC = "/tunnel_select"
LATCHED_FLOWS = QosProfile(depth=50, durability=Durability.TRANSIENT_LOCAL)
_ROLES = {"relay": Role.RELAY, "out": Role.TUNNEL_START, "in": Role.TUNNEL_END}
_AGAIN_S = 1.0


class FlowRelay(Engine):
    """Relays tagged topics type-agnostically, with statistics, throttle and tunnels.

    Parameters of its node: ``tag``, ``out_tag``, ``in_tag``, ``tunnel_tag``, ``qci_tag`` (ends of names);
    ``topics`` (tagged topics to take up; none for all); ``roles`` (of relay, out, in); ``only_local``
    (only topics that begin, or come out, on this host); ``transports``; ``window_s``, ``stats_period_s``;
    ``qcis`` (tunnels of each topic, one for each class; none for one without); ``latency_budgets``
    (``TOPIC=MS``); ``dscp`` (``TOPIC=CODE``); ``mark`` (mark flows as the class that was asked for
    them); ``reorder`` (``drop_late``, ``hold``), ``hold_ms``.
    """

    node_name: ClassVar[str] = "flow_relay"
    summary: ClassVar[str] = "Tagged topics, each on a network flow of its own."

    def __init__(self) -> None:
        self.relayed: dict[Wanted, RelayedTopic] = {}
        self.ends: dict[str, TunnelEnd] = {}
        self._node: NodeHandle | None = None
        self._plan = PlanSettings()
        self._refused: dict[str, str] = {}
        self._changed = asyncio.Event()
        self._flows: Publisher[UniqueTopicFlows] | None = None
        self._budgets: dict[str, float] = {}
        self._dscp: dict[str, float] = {}

    async def run(self, node: NodeHandle) -> None:
        """Work until cancelled or the node ends.

        Raises:
            ConfigError: A parameter makes no sense.
        """
        self._node = node
        await self._declare(node)
        self._flows = await node.advertise(FLOWS_TOPIC, UniqueTopicFlows, qos=LATCHED_FLOWS)
        stats = await node.advertise(STATS_TOPIC, UniqueTopicFlowStats, qos=QosProfile(depth=10))
        await node.subscribe(THROTTLE_TOPIC, Throttle, self._throttle)
        await node.subscribe(SELECT_TOPIC, TunnelSelect, self._select)
        await node.subscribe(QOS_TOPIC, FlowQosArray, self._qos)
        self._publish_flows()
        period_s = float(node.parameters["~stats_period_s"])
        node.create_timer(period_s, lambda _: stats.publish(self._stats()))
        tasks = [
            asyncio.create_task(work) for work in (self._watch(), self._keep_up(), node.spin())
        ]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            await self._close()

    async def _declare(self, node: NodeHandle) -> None:
        get = node.declare_parameter
        tags = TagRules()
        rules = TagRules(
            str(await get("~tag", tags.relay, read_only=True)),
            str(await get("~out_tag", tags.start, read_only=True)),
            str(await get("~in_tag", tags.end, read_only=True)),
            str(await get("~tunnel_tag", tags.tunnel, read_only=True)),
            str(await get("~qci_tag", tags.per_qci, read_only=True)),
        )
        topics = await get("~topics", [], type="string[]", read_only=True)
        roles = await get("~roles", list(_ROLES), read_only=True)
        only_local = bool(await get("~only_local", False, read_only=True))
        await get("~transports", ["tcp"], read_only=True)
        await get("~window_s", 5.0, minimum=2.0, maximum=10.0, read_only=True)
        await get("~stats_period_s", 1.0, minimum=0.05, maximum=60.0, read_only=True)
        await get("~qcis", [], type="int[]", read_only=True)
        await get("~mark", True)
        await get("~reorder", "drop_late", choices=("drop_late", "hold"), read_only=True)
        await get("~hold_ms", 50.0, minimum=0.0, maximum=10_000.0, read_only=True)
        self._budgets = _pairs(
            "latency_budgets", await get("~latency_budgets", [], type="string[]", read_only=True)
        )
        self._dscp = _pairs("dscp", await get("~dscp", [], type="string[]", read_only=True))
        unknown = set(roles) - _ROLES.keys()
        if unknown:
            raise ConfigError(f"roles: {', '.join(unknown)} is none of {', '.join(_ROLES)}")
        self._plan = PlanSettings(
            rules,
            frozenset(_ROLES[name] for name in roles),
            frozenset(node.resolve_name(topic) for topic in topics),
            node.ip if only_local else "",
        )

    # -- the graph -------------------------------------------------------------------------------

    async def _watch(self) -> None:
        """Notice changes of the graph, whatever Masters come and go."""
        assert self._node is not None
        while True:
            try:
                async for _ in self._node.client.watch_graph():
                    self._changed.set()
            except MasterUnavailable as error:
                logger.info("the graph cannot be seen: %s", error)
            await asyncio.sleep(_AGAIN_S)

    async def _keep_up(self) -> None:
        """Follow the graph; what changes meanwhile is looked at once, afterwards."""
        while True:
            await self._changed.wait()
            self._changed.clear()
            try:
                await self._follow()
            except SimpleRosError as error:
                logger.warning("the graph cannot be followed now: %s", error)
                self._changed.set()
                await asyncio.sleep(_AGAIN_S)

    async def _follow(self) -> None:
        assert self._node is not None
        graph = await fetch_graph(self._node.client)
        wanted = plan(graph, self._node.name, self._plan)
        self._report(wanted.refused)
        for want in wanted.wanted - self.relayed.keys():
            if want.role is not Role.TUNNEL_END:
                await self._take_up(want)
        for want in self.relayed.keys() - wanted.wanted:
            await self.relayed.pop(want).close()
            self._publish_flows()
        await self._follow_ends(wanted)

    def _report(self, refused: dict[str, str]) -> None:
        for topic, reason in refused.items():
            if self._refused.get(topic) != reason:
                logger.warning("%s is not relayed: %s", topic, reason)
        self._refused = refused

    async def _take_up(self, want: Wanted) -> None:
        assert self._node is not None
        is_tunnel = want.role is Role.TUNNEL_START
        parameters = self._node.parameters
        qcis: Sequence[int] = parameters["~qcis"] if is_tunnel else ()
        rules = self._plan.rules
        outputs = {rules.tunnel_topic(want.base, qci): qci for qci in qcis} or {
            rules.tunnel_topic(want.base) if is_tunnel else want.base: 0
        }
        try:
            offered = await offered_by(self._node.client, want.source)
            settings = TopicSettings(
                tuple(parameters["~transports"]),
                float(parameters["~window_s"]),
                qcis,
                offered.profile(self._said(self._budgets, want) or 0.0),
                offered.relayed,
                _code_point(self._said(self._dscp, want)),
            )
            topic = RelayedTopic(
                self._node, want, outputs, settings, is_tunnel=is_tunnel, on_flow=self._flow_changed
            )
            self.relayed[want] = topic
            await topic.start()
            self._publish_flows()
        except SimpleRosError as error:
            logger.warning("%s cannot be relayed: %s", want.source, error)
            failed = self.relayed.pop(want, None)
            if failed is not None:
                await failed.close()

    def _said(self, values: dict[str, float], want: Wanted) -> float | None:
        """What was said about a topic, by its name with or without the tag."""
        return values.get(want.base, values.get(want.source))

    async def _follow_ends(self, wanted: RelayPlan) -> None:
        assert self._node is not None
        bases = {want.base for want in wanted.wanted if want.role is Role.TUNNEL_END}
        parameters = self._node.parameters
        for base in self.ends.keys() - bases:
            await self.ends.pop(base).close()
        for base in bases:
            if base not in self.ends:
                hold_s = float(parameters["~hold_ms"]) / 1000
                self.ends[base] = TunnelEnd(
                    self._node,
                    self._plan.rules.out_topic(base),
                    HoldBack(hold_s) if parameters["~reorder"] == "hold" else DropLate(),
                    float(parameters["~window_s"]),
                )
            await self.ends[base].follow(wanted.tunnels[base])

    async def _close(self) -> None:
        for topic in self.relayed.values():
            await topic.close()
        for end in self.ends.values():
            await end.close()
        self.relayed.clear()
        self.ends.clear()

    # -- what it is told -------------------------------------------------------------------------

    def _throttle(self, message: Throttle) -> None:
        try:
            settings = ThrottleSettings(
                message.drop_every_nth, message.message_delay, message.delay_ms
            )
        except ConfigError as error:
            logger.warning("throttle of %s: %s", message.topic, error)
            return
        for topic in self._of(message.topic):
            topic.set_throttle(settings)

    def _select(self, message: TunnelSelect) -> None:
        for topic in self._of(message.topic):
            if topic.is_tunnel and not topic.select(message.qci):
                logger.warning("%s has no tunnel for QCI %d", topic.topic, message.qci)

    def _of(self, name: str) -> list[RelayedTopic]:
        """The topics of a name: without its tag, or with that of a tunnel's end, or all for none."""
        assert self._node is not None
        if not name:
            return list(self.relayed.values())
        name = self._node.resolve_name(name)
        rules = self._plan.rules
        return [
            topic
            for topic in self.relayed.values()
            if name in (topic.wanted.base, topic.wanted.source, rules.out_topic(topic.wanted.base))
        ]

    def _qos(self, message: FlowQosArray) -> None:
        assert self._node is not None
        if not self._node.parameters["~mark"]:
            return
        marked = [
            topic.mark(flow.topic, flow.applied_qci or flow.qci)
            for flow in message.flows
            if flow.qci
            for topic in self.relayed.values()
        ]
        if any(marked):
            self._publish_flows()

    # -- what it says ----------------------------------------------------------------------------

    def _flow_changed(self, flow: UniqueTopicFlow) -> None:
        self._publish_flows(flow)

    def _publish_flows(self, *changed: UniqueTopicFlow) -> None:
        assert self._node is not None
        assert self._flows is not None
        message = UniqueTopicFlows(
            relay=self._node.name,
            changed=changed,
            flows=[flow for topic in self.relayed.values() for flow in topic.flows()],
        )
        message.header.stamp.FromNanoseconds(self._node.clock.now().nanoseconds)
        try:
            self._flows.publish(message)
        except SimpleRosError as error:
            # Connections end with the node, too.
            logger.debug("flows are not told: %s", error)

    def _stats(self) -> UniqueTopicFlowStats:
        assert self._node is not None
        message = UniqueTopicFlowStats(
            relay=self._node.name,
            stats=[stat for topic in self.relayed.values() for stat in topic.stats()],
            tunnel_stats=[end.stat() for end in self.ends.values()],
        )
        message.header.stamp.FromNanoseconds(self._node.clock.now().nanoseconds)
        return message


def _pairs(what: str, items: Sequence[str]) -> dict[str, float]:
    """``TOPIC=NUMBER`` as a table.

    Raises:
        ConfigError: One is of another form.
    """
    found = {}
    for item in items:
        topic, _, number = item.rpartition("=")
        try:
            found[topic.strip("/")] = float(number)
        except ValueError as error:
            raise ConfigError(f"{what}: {item!r} is not TOPIC=NUMBER") from error
    return found


def _code_point(number: float | None) -> int | None:
    return None if number is None else int(number)
