"""The Unique Flow Topic Relay: tagged topics, each on connections of its own that the network can tell apart."""

from __future__ import annotations

import asyncio
import logging
from typing import ClassVar

from simple_ros.engine import Engine
from simple_ros.errors import ConfigError, MasterUnavailable, SimpleRosError
from simple_ros.graph import GraphSnapshot
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
from simple_ros_engines.network_exposure.relay_plan import (
    FLOWS_TOPIC,
    RelayPlan,
    Wanted,
    plan,
)
from simple_ros_engines.network_exposure.relay_settings import RelaySettings, relay_settings
from simple_ros_engines.network_exposure.relayed import RelayedTopic
from simple_ros_engines.network_exposure.tags import Role
from simple_ros_engines.network_exposure.throttle import ThrottleSettings
from simple_ros_engines.network_exposure.tunnel_end import TunnelEnd

__all__ = ["FLOWS_TOPIC", "STATS_TOPIC", "FlowRelay"]

logger = logging.getLogger(__name__)

STATS_TOPIC = "/unique_network_flow_stats"
QOS_TOPIC = "/network_flow_state"
THROTTLE_TOPIC = "/throttle"
SELECT_TOPIC = "/tunnel_select"
LATCHED_FLOWS = QosProfile(depth=50, durability=Durability.TRANSIENT_LOCAL)
_AGAIN_S = 1.0
_REFRESH_S = 10.0
Publishing = frozenset[tuple[str, str, int]]
"""Nodes by name, address and port: a node that was started again is another one."""


class FlowRelay(Engine):
    """Relays tagged topics type-agnostically, with statistics, throttle and tunnels.

    Parameters of its node: ``tag``, ``out_tag``, ``in_tag``, ``tunnel_tag``, ``qci_tag`` (ends of names);
    ``topics`` (tagged topics to take up; none for all); ``roles`` (of relay, out, in); ``only_local``
    (only topics that begin, or come out, on this host); ``transports``; ``window_s``, ``stats_period_s``;
    ``qcis`` (tunnels of each topic, one for each class; none for one without); ``latency_budgets``
    (``TOPIC=MS``); ``dscp`` (``TOPIC=CODE``); ``mark`` (mark flows as the class that was asked for
    them); ``throttle_valid_s`` (a throttle ends by itself after so long, unless its sender says otherwise or
    says it again; 0: it stays); ``reorder`` (``drop_late``, ``hold``), ``hold_ms``.
    """

    node_name: ClassVar[str] = "flow_relay"
    summary: ClassVar[str] = "Tagged topics, each on a network flow of its own."

    def __init__(self) -> None:
        self.relayed: dict[Wanted, RelayedTopic] = {}
        self.ends: dict[str, TunnelEnd] = {}
        self._node: NodeHandle | None = None
        self._settings = RelaySettings()
        self._refused: dict[str, str] = {}
        self._offerers: dict[Wanted, Publishing] = {}
        self._is_stale = False
        self._changed = asyncio.Event()
        self._flows: Publisher[UniqueTopicFlows] | None = None

    async def run(self, node: NodeHandle) -> None:
        """Work until cancelled or the node ends.

        Raises:
            ConfigError: A parameter makes no sense.
        """
        self._node = node
        self._settings = await relay_settings(node)
        self._flows = await node.advertise(FLOWS_TOPIC, UniqueTopicFlows, qos=LATCHED_FLOWS)
        stats = await node.advertise(STATS_TOPIC, UniqueTopicFlowStats, qos=QosProfile(depth=10))
        await node.subscribe(THROTTLE_TOPIC, Throttle, self._throttle)
        await node.subscribe(SELECT_TOPIC, TunnelSelect, self._select)
        await node.subscribe(QOS_TOPIC, FlowQosArray, self._qos)
        self._publish_flows()
        node.create_timer(self._settings.stats_period_s, lambda _: stats.publish(self._stats()))
        node.create_timer(_REFRESH_S, lambda _: self._refresh())
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

    def _refresh(self) -> None:
        """Look again, and say again: what changed may have been no change of the graph, or told to nobody."""
        self._is_stale = True
        self._changed.set()
        self._publish_flows()

    async def _follow(self) -> None:
        assert self._node is not None
        graph = await fetch_graph(self._node.client)
        wanted = plan(graph, self._node.name, self._settings.plan, self._held())
        self._report(wanted.refused)
        for want in self.relayed.keys() - wanted.wanted:
            await self.relayed.pop(want).close()
            self._publish_flows()
        is_stale, self._is_stale = self._is_stale, False
        for want in wanted.wanted:
            if want.role is Role.TUNNEL_END:
                continue
            now = _publishing(graph, want.source)
            if want not in self.relayed:
                await self._take_up(want)
            elif is_stale or now != self._offerers.get(want):
                await self._look_at_offers(want)
            self._offerers[want] = now
        await self._follow_ends(wanted)

    def _held(self) -> set[Wanted]:
        """What this relay hands on now."""
        rules = self._settings.plan.rules
        ends = {Wanted(Role.TUNNEL_END, base, rules.tunnel_topic(base)) for base in self.ends}
        return self.relayed.keys() | ends

    async def _look_at_offers(self, want: Wanted) -> None:
        """A publisher came or went: the topic offers what all of them offer."""
        assert self._node is not None
        topic = self.relayed[want]
        offered = await offered_by(self._node.client, want.source)
        profile = self._settings.profile(want, offered)
        if (profile, offered.relayed) != (topic.profile, topic.settings.qos):
            logger.info("%s offers something else now", want.source)
            await topic.reoffer(profile, offered.relayed)
            self._publish_flows()

    def _report(self, refused: dict[str, str]) -> None:
        for topic, reason in refused.items():
            if self._refused.get(topic) != reason:
                logger.warning("%s is not relayed: %s", topic, reason)
        self._refused = refused

    async def _take_up(self, want: Wanted) -> None:
        assert self._node is not None
        try:
            offered = await offered_by(self._node.client, want.source)
            topic = RelayedTopic(
                self._node,
                want,
                self._settings.outputs(want),
                self._settings.of(want, offered),
                is_tunnel=want.role is Role.TUNNEL_START,
                on_flow=self._flow_changed,
            )
            self.relayed[want] = topic
            await topic.start()
            self._publish_flows()
        except SimpleRosError as error:
            logger.warning("%s cannot be relayed: %s", want.source, error)
            failed = self.relayed.pop(want, None)
            if failed is not None:
                await failed.close()

    async def _follow_ends(self, wanted: RelayPlan) -> None:
        assert self._node is not None
        bases = {want.base for want in wanted.wanted if want.role is Role.TUNNEL_END}
        settings = self._settings
        for base in self.ends.keys() - bases:
            await self.ends.pop(base).close()
        for base in bases:
            if base not in self.ends:
                out = settings.plan.rules.out_topic(base)
                self.ends[base] = TunnelEnd(self._node, out, settings.order(), settings.window_s)
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
        assert self._node is not None
        valid_s = message.valid_s or float(self._node.parameters["~throttle_valid_s"])
        try:
            settings = ThrottleSettings(
                message.drop_every_nth, message.message_delay, message.delay_ms
            )
            for topic in self._of(message.topic):
                topic.set_throttle(settings, valid_s)
        except ConfigError as error:
            logger.warning("throttle of %s: %s", message.topic, error)

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
        rules = self._settings.plan.rules
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


def _publishing(graph: GraphSnapshot, topic: str) -> Publishing:
    return frozenset(
        (node.name, node.ip, node.port)
        for node in graph.nodes
        if any(key.topic == topic for key in node.publishes)
    )
