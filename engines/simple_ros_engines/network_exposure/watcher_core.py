"""The topic watcher's mind: flows, what is measured of them, what the network is asked. Pure but for messages.

It is told messages, results and the time; `look` says which commands are due.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from simple_ros.errors import ConfigError
from simple_ros.msg.network_exposure_msgs import (
    FlowQos,
    QosAdvice,
    TunnelSelect,
    UniqueTopicFlow,
    UniqueTopicFlows,
    UniqueTopicFlowStat,
    UniqueTopicFlowStats,
)
from simple_ros_engines.network_exposure.exposure.model import (
    FiveTuple,
    Notification,
    QosRequest,
    Session,
    UeIdentity,
)
from simple_ros_engines.network_exposure.flow_messages import (
    five_tuple,
    profile_of,
    traffic_of,
)
from simple_ros_engines.network_exposure.flow_session import (
    Command,
    FlowSession,
    SessionSettings,
)
from simple_ros_engines.network_exposure.qci import qos_class
from simple_ros_engines.network_exposure.qos_mapper import (
    MapperSettings,
    Mode,
    Requirement,
    Selection,
)
from simple_ros_engines.network_exposure.requirement import Advice, FlowMapper, wire_bandwidth

__all__ = ["Due", "Identities", "WatchedFlow", "WatcherCore", "WatcherSettings"]

FlowKey = tuple[str, FiveTuple]
_RELAY_SILENT_S = 30.0
"""Relays tell their flows every ten seconds; one that has not for so long is gone."""


@dataclass(frozen=True, slots=True)
class Identities:
    """Which end of a flow is a device of the network, and who it is.

    Attributes:
        by_ip: Identifiers (GPSI) by address.
        gpsi: Of the sender, where no address is known.
    """

    by_ip: dict[str, str] = field(default_factory=dict)
    gpsi: str = ""

    def of(self, flow: FiveTuple) -> UeIdentity:
        """The device of a flow."""
        for ip, is_uplink in ((flow.source_ip, True), (flow.destination_ip, False)):
            if ip in self.by_ip:
                return UeIdentity(self.by_ip[ip], ip, is_uplink)
        return UeIdentity(self.gpsi, flow.source_ip)


@dataclass(frozen=True, slots=True)
class WatcherSettings:
    """How it works.

    Attributes:
        session: Of each flow.
        mapper: Of each flow.
        identities: Of devices.
        idle_s: A flow that sends nothing for so long is released, unless its topic has a lease.
    """

    session: SessionSettings = field(default_factory=SessionSettings)
    mapper: MapperSettings = field(default_factory=MapperSettings)
    identities: Identities = field(default_factory=Identities)
    idle_s: float = 60.0


@dataclass(slots=True)
class WatchedFlow:
    """One flow.

    Attributes:
        message: As its relay told.
        relay: Which.
        session: What is asked for it.
        mapper: What it needs.
        active_s: When it sent last.
        is_present: Whether its relay still has it.
    """

    message: UniqueTopicFlow
    flow: FiveTuple
    relay: str
    session: FlowSession
    mapper: FlowMapper
    active_s: float
    is_present: bool = True
    messages: int = -1


@dataclass(frozen=True, slots=True)
class Due:
    """A command for a flow.

    Attributes:
        key: Whose.
        command: What.
        request: For the network; None for commands that need none.
        ue: Its device.
    """

    key: FlowKey
    command: Command
    request: QosRequest | None
    ue: UeIdentity


class WatcherCore:
    """All flows.

    Args:
        settings: How it works.

    Attributes:
        flows: By topic and 5-tuple.
        advice: By topic; used in mode ``ai`` only.
        steering: Tunnels to take from now on; taken by who publishes them.
    """

    def __init__(self, settings: WatcherSettings | None = None) -> None:
        self.flows: dict[FlowKey, WatchedFlow] = {}
        self.advice: dict[str, Advice] = {}
        self.steering: list[TunnelSelect] = []
        self._settings = settings or WatcherSettings()
        self._is_ending = False
        self._steered: dict[str, int] = {}
        self._heard_s: dict[str, float] = {}

    # -- what it is told -------------------------------------------------------------------------

    def flows_came(self, message: UniqueTopicFlows, now_s: float) -> None:
        """A relay told its flows."""
        self._heard_s[message.relay] = now_s
        present = {(item.topic, five_tuple(item)): item for item in message.flows}
        for key, item in present.items():
            known = self.flows.get(key)
            if known is None:
                settings = self._settings
                session, mapper = FlowSession(settings.session), FlowMapper(settings.mapper)
                known = WatchedFlow(item, key[1], message.relay, session, mapper, now_s)
                self.flows[key] = known
            known.message, known.is_present = item, True
        for key, known in self.flows.items():
            if known.relay == message.relay and key not in present:
                known.is_present = False
                known.session.release()

    def stats_came(self, message: UniqueTopicFlowStats, now_s: float) -> None:
        """A relay told what it sends."""
        self._heard_s[message.relay] = now_s
        by_topic = {stat.topic: stat for stat in message.stats}
        for known in self.flows.values():
            stat = by_topic.get(known.message.topic)
            if stat is None or known.relay != message.relay or not known.is_present:
                continue
            if known.message.tunnel_qci:
                self._tunnel_measured(known, by_topic, now_s)
            elif stat.num_messages != known.messages:
                known.messages, known.active_s = stat.num_messages, now_s
                self._measured(known, stat, now_s)
        self._steer(message, now_s)

    def _measured(self, known: WatchedFlow, stat: UniqueTopicFlowStat, now_s: float) -> None:
        found = self._mapped(known, stat, now_s)
        if found is not None and not self._is_ending:
            known.session.want(found, now_s)

    def _mapped(
        self, known: WatchedFlow, stat: UniqueTopicFlowStat, now_s: float
    ) -> Selection | None:
        return known.mapper.look(
            traffic_of(stat),
            stat.window_burst,
            profile_of(known.message),
            now_s,
            self._advice_of(known.message.topic, now_s),
        )

    def _tunnel_measured(
        self, known: WatchedFlow, by_topic: dict[str, UniqueTopicFlowStat], now_s: float
    ) -> None:
        """A tunnel for one class asks for that class before it is used: then switching costs nothing."""
        stat = self._taken(known, by_topic)
        row = qos_class(known.message.tunnel_qci)
        if stat is None or row is None or self._is_ending:
            return
        known.active_s = now_s
        needed = Requirement(
            row.resource,
            row.delay_ms,
            row.error_rate,
            stat.window_burst,
            8 * wire_bandwidth(traffic_of(stat)),
        )
        known.session.want(Selection(row, (), needed), now_s)

    def _taken(
        self, known: WatchedFlow, by_topic: dict[str, UniqueTopicFlowStat]
    ) -> UniqueTopicFlowStat | None:
        """What the topic of a tunnel sends, by whichever tunnel."""
        for other in self.flows.values():
            stat = by_topic.get(other.message.topic)
            is_same = other.message.source_topic == known.message.source_topic
            if is_same and stat is not None and stat.window_bandwidth > 0:
                return stat
        return None

    def _steer(self, message: UniqueTopicFlowStats, now_s: float) -> None:
        """Which tunnel each topic is to take: the one of the class that the mapper selects."""
        tunnels: dict[str, dict[int, WatchedFlow]] = {}
        for known in self.flows.values():
            if known.message.tunnel_qci and known.relay == message.relay and known.is_present:
                by_qci = tunnels.setdefault(known.message.source_topic, {})
                by_qci[known.message.tunnel_qci] = known
        stats = {stat.topic: stat for stat in message.stats}
        for source, by_qci in tunnels.items():
            first = next(iter(by_qci.values()))
            stat = self._taken(first, stats)
            found = None if stat is None else self._mapped(first, stat, now_s)
            if found is None:
                continue
            rows = (found.chosen, *found.alternatives)
            qci = next((row.qci for row in rows if row.qci in by_qci), 0)
            if qci and self._steered.get(source) != qci:
                self._steered[source] = qci
                self.steering.append(TunnelSelect(topic=source, qci=qci))

    def advised(self, message: QosAdvice, now_s: float) -> None:
        """A policy told what to ask for on a topic.

        Raises:
            ConfigError: It makes no sense; what was told before stands.
        """
        topic, valid_s = message.topic.strip("/"), message.valid_s
        if message.clear:
            self.advice.pop(topic, None)
            return
        if not 0 <= valid_s < math.inf:
            raise ConfigError(f"valid_s must be a number of seconds, not {valid_s:g}")
        ends_s = now_s + valid_s if valid_s else math.inf
        self.advice[topic] = Advice(
            message.latency_budget_ms, message.error_rate, message.qci, ends_s
        )

    def _advice_of(self, topic: str, now_s: float) -> Advice | None:
        """What to ask for on a topic, if somebody says so and has not died since."""
        if self._settings.session.mode is not Mode.AI:
            return None
        known = self.advice.get(topic.strip("/"))
        return None if known is None or now_s >= known.ends_s else known

    def told(self, notification: Notification, now_s: float) -> WatchedFlow | None:
        """The network said something; about which flow, if that is known."""
        for known in self.flows.values():
            session = known.session
            if session.session_id and session.session_id == notification.session_id:
                detail = notification.detail
                session.told(notification.event, notification.applied_qci, now_s, detail)
                return known
        return None

    def done(self, key: FlowKey, now_s: float, session: Session | None = None) -> None:
        """A command succeeded."""
        self.flows[key].session.done(now_s, session)

    def failed(self, key: FlowKey, now_s: float, detail: str, retry_after_s: float | None) -> None:
        """A command failed."""
        self.flows[key].session.failed(now_s, detail, retry_after_s)

    def lost(self, key: FlowKey, now_s: float, detail: str) -> None:
        """The network does not know the session a command was about."""
        self.flows[key].session.lost(now_s, detail)

    def end(self) -> None:
        """Release everything."""
        self._is_ending = True
        for known in self.flows.values():
            known.session.release()

    # -- what it says ----------------------------------------------------------------------------

    def look(self, now_s: float) -> list[Due]:
        """What is due; it counts as begun."""
        due = []
        self.advice = {topic: told for topic, told in self.advice.items() if now_s < told.ends_s}
        for key, known in tuple(self.flows.items()):
            self._rest(known, now_s)
            if known.session.is_over and not known.is_present and not self._is_ending:
                del self.flows[key]
                continue
            command = known.session.next_command(now_s)
            if command is not None:
                ue = self._settings.identities.of(known.flow)
                due.append(Due(key, command, self._request(known, command, ue), ue))
        return due

    def _rest(self, known: WatchedFlow, now_s: float) -> None:
        """Release what has become silent, after the lease of its topic or else the idle time; forget what is gone."""
        lease_s = known.message.lease_ms / 1000 or self._settings.idle_s
        if known.session.wanted is not None and now_s - known.active_s > lease_s:
            known.session.release()
        silent_s = now_s - self._heard_s[known.relay]
        if silent_s > max(_RELAY_SILENT_S, self._settings.idle_s):
            known.is_present = False
            known.session.release()

    def _request(self, known: WatchedFlow, command: Command, ue: UeIdentity) -> QosRequest | None:
        selection = command.selection
        if selection is None:
            return None
        return QosRequest(
            known.message.topic,
            known.flow,
            ue,
            selection.chosen,
            selection.alternatives,
            selection.requirement.bit_rate,
            selection.requirement.burst_bytes,
            self._settings.session.duration_s,
        )

    def status(self) -> list[FlowQos]:
        """All flows as messages."""
        return [_status(known) for known in self.flows.values()]


def _status(known: WatchedFlow) -> FlowQos:
    session = known.session
    message = FlowQos(
        topic=known.message.topic,
        state=session.state.value,
        applied_qci=session.applied_qci or 0,
        session_id=session.session_id,
        detail=session.detail,
        requests=session.requests,
        source=known.message.source,
        destination=known.message.destination,
        is_refused=session.is_refused,
    )
    shown = session.asked or session.wanted
    if shown is not None:
        needed = shown.requirement
        message.qci = shown.qci
        message.alternatives.extend(row.qci for row in shown.alternatives)
        message.is_unmet = shown.is_unmet
        message.is_gbr = shown.chosen.is_gbr
        message.delay_budget_ms = needed.delay_ms
        message.error_rate = needed.error_rate
        message.burst_bytes = needed.burst_bytes
        message.bit_rate = needed.bit_rate
        message.warnings.extend((*shown.warnings, *shown.misses))
    return message
