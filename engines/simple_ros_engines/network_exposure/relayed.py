"""One topic that a relay hands on, plainly or into a tunnel."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from simple_ros.large import LargeMessage, large
from simple_ros.msg.network_exposure_msgs import Serialized, UniqueTopicFlow, UniqueTopicFlowStat
from simple_ros.net.transport import Transport
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher
from simple_ros.qos import Durability, QosProfile, Reliability
from simple_ros.subscriber import Subscriber
from simple_ros_engines.marking import Marks
from simple_ros_engines.network_exposure.exposure.model import FiveTuple
from simple_ros_engines.network_exposure.flow_messages import flow_message
from simple_ros_engines.network_exposure.flows import FlowSet, flowing
from simple_ros_engines.network_exposure.qci import dscp_of
from simple_ros_engines.network_exposure.raw import Raw, raw_class
from simple_ros_engines.network_exposure.relay_plan import Wanted
from simple_ros_engines.network_exposure.requirement import FlowProfile, delay_needed_ms
from simple_ros_engines.network_exposure.statistics import FlowMeter
from simple_ros_engines.network_exposure.throttle import Throttle, ThrottleSettings

__all__ = ["TAKES_ANY", "LargeSerialized", "RelayedTopic", "TopicSettings"]

logger = logging.getLogger(__name__)

LargeSerialized = large(Serialized)
TAKES_ANY = QosProfile(depth=100, reliability=Reliability.BEST_EFFORT)
"""Requests nothing that a publisher might not offer; what it offers is kept up all the same."""
_BURST_SHARE = 0.9
"""Of the delay needed: two messages that are a period apart, less their jitter, are no burst."""
_MOST_HELD = 100
_LINKED_AGAIN_S = 1.0
FlowCallback = Callable[[UniqueTopicFlow], None]


@dataclass(frozen=True, slots=True)
class TopicSettings:
    """How topics are handed on.

    Attributes:
        transports: How, most wanted first.
        window_s: Of the statistics.
        qcis: Tunnels of a topic, one for each class; none for one without a class.
        profile: Of the topic.
        qos: What is offered.
        dscp: Code point from the beginning; None leaves it alone.
    """

    transports: Sequence[str] = ("tcp",)
    window_s: float = 5.0
    qcis: Sequence[int] = ()
    profile: FlowProfile = field(default_factory=FlowProfile)
    qos: QosProfile = field(default_factory=QosProfile)
    dscp: int | None = None


@dataclass(slots=True)
class _Way:
    """One publisher that the topic may take."""

    topic: str
    qci: int
    marks: Marks
    flows: FlowSet
    transports: tuple[Transport, ...]
    publisher: Publisher[Any] | None = None
    sent: int = 0


class RelayedTopic:
    """Takes a topic's messages and hands them on.

    Args:
        node: The relay's.
        wanted: The topic.
        outputs: Topics it may go to, with their classes (0 for none).
        settings: How.
        is_tunnel: Whether it goes encapsulated.
        on_flow: Called with each flow that came or went.

    Attributes:
        throttle: Makes it worse on purpose.
        meter: Counts what goes out.
    """

    def __init__(
        self,
        node: NodeHandle,
        wanted: Wanted,
        outputs: dict[str, int],
        settings: TopicSettings,
        *,
        is_tunnel: bool,
        on_flow: FlowCallback,
    ) -> None:
        self.wanted = wanted
        self.throttle: Throttle[Raw] = Throttle()
        self.meter = FlowMeter(settings.window_s)
        self.settings = settings
        self.is_tunnel = is_tunnel
        self._node = node
        self._outputs = outputs
        self._on_flow = on_flow
        self._ways: list[_Way] = []
        self._chosen = 0
        self._held: deque[Raw] = deque(maxlen=_MOST_HELD)
        self._is_reopening = False
        self._subscriber: Subscriber[Raw] | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._lapsing: asyncio.TimerHandle | None = None
        self._loop = asyncio.get_running_loop()
        self._session = time.time_ns()
        self._start_s = time.time()

    @property
    def topic(self) -> str:
        """How it is known: what comes out in the end has this name, or with the tag of a tunnel's end."""
        return self.wanted.base

    @property
    def profile(self) -> FlowProfile:
        """What it needs by its own QoS."""
        return self.settings.profile

    async def start(self) -> None:
        """Advertise and subscribe."""
        for topic, qci in self._outputs.items():
            way = self._way(topic, qci)
            # Connections may stand before `advertise` has returned.
            self._ways.append(way)
            await self._advertise(way)
        await self._subscribe()

    async def _subscribe(self) -> None:
        self._subscriber = await self._node.subscribe(
            self.wanted.source, raw_class(self.wanted.msg_type), self._came, qos=TAKES_ANY
        )

    def _way(self, topic: str, qci: int) -> _Way:
        def changed(flow: FiveTuple, is_there: bool) -> None:
            event = UniqueTopicFlow.ADDED if is_there else UniqueTopicFlow.REMOVED
            self._on_flow(self._message(way, flow, event))

        transports, marks, flows = flowing(self.settings.transports, changed)
        dscp = dscp_of(qci) if qci else self.settings.dscp
        if dscp is not None:
            marks.set(dscp=dscp)
        way = _Way(topic, qci, marks, flows, transports)
        return way

    async def _advertise(self, way: _Way) -> Publisher[Any]:
        message_class: type[Raw | LargeMessage[Serialized]] = (
            LargeSerialized if self.is_tunnel else raw_class(self.wanted.msg_type)
        )
        way.publisher = await self._node.advertise(
            way.topic, message_class, qos=self.settings.qos, transports=way.transports
        )
        return way.publisher

    async def reoffer(self, profile: FlowProfile, qos: QosProfile) -> None:
        """The application's publishers offer something else: so does the relay, and it tells that.

        Where what is offered to subscribers changes, connections are made anew; messages that come meanwhile wait.
        """
        is_same = qos == self.settings.qos and all(way.publisher for way in self._ways)
        self.settings = replace(self.settings, profile=profile, qos=qos)
        if is_same:
            return
        self._is_reopening = True
        try:
            for way in self._ways:
                await self._reopen(way)
        finally:
            self._is_reopening = False
        while self._held:
            self._send(self._held.popleft())
        if qos.durability is Durability.TRANSIENT_LOCAL and self._subscriber is not None:
            # A publisher that is new has no history: the application's is asked for it.
            await self._subscriber.close()
            await self._subscribe()

    async def _reopen(self, way: _Way) -> None:
        old, way.publisher = way.publisher, None
        linked = 0 if old is None else old.subscriber_count
        if old is not None:
            await old.close()
        publisher = await self._advertise(way)
        with contextlib.suppress(TimeoutError):
            await publisher.wait_for_subscribers(linked, _LINKED_AGAIN_S)

    async def close(self) -> None:
        """End it."""
        for timer in (self._timer, self._lapsing):
            if timer is not None:
                timer.cancel()
        if self._subscriber is not None:
            await self._subscriber.close()
        for way in self._ways:
            if way.publisher is not None:
                await way.publisher.close()

    # -- messages --------------------------------------------------------------------------------

    def _came(self, message: Raw) -> None:
        for due in self.throttle.put(message, self._loop.time()):
            self._send(due)
        self._schedule()

    def _schedule(self) -> None:
        due_s = self.throttle.next_due_s()
        if due_s is not None and self._timer is None:
            self._timer = self._loop.call_at(due_s, self._ring)

    def _ring(self) -> None:
        self._timer = None
        for due in self.throttle.due(self._loop.time()):
            self._send(due)
        self._schedule()

    def _send(self, message: Raw) -> None:
        way = self._ways[self._chosen]
        publisher = way.publisher
        if publisher is None or self._is_reopening:
            self._held.append(message)
            return
        if publisher.subscriber_count:
            self.meter.sent(len(message), self._loop.time())
            way.sent += 1
        elif self.is_tunnel:
            return
        publisher.publish(self._packed(message, way) if self.is_tunnel else message)

    def _packed(self, message: Raw, way: _Way) -> LargeMessage[Serialized]:
        head = Serialized(
            message_type=self.wanted.msg_type,
            sent_ns=time.time_ns(),
            msg_num=self.meter.messages,
            throttled=self.throttle.dropped + self.throttle.overflowed,
            session=self._session,
            priority=way.marks.dscp or 0,
        )
        return LargeSerialized(head, message.data)

    # -- what it is told -------------------------------------------------------------------------

    def set_throttle(self, settings: ThrottleSettings, valid_s: float = 0.0) -> None:
        """Make it worse, or no worse any more; for ``valid_s`` seconds unless it is said again, 0 for good.

        Raises:
            ConfigError: The time is no number of seconds.
        """
        self.throttle.ask(settings, self._loop.time(), valid_s)
        if self._lapsing is not None:
            self._lapsing.cancel()
        ends_s = self.throttle.ends_s
        self._lapsing = None if ends_s is None else self._loop.call_at(ends_s, self._lapse)
        self._hurry()

    def _lapse(self) -> None:
        self._lapsing = None
        # A loop may ring a moment early.
        if self.throttle.lapse(max(self._loop.time(), self.throttle.ends_s or 0.0)):
            logger.warning("%s is throttled no more: nobody has said so again", self.topic)
        self._hurry()

    def _hurry(self) -> None:
        """What waited by other settings may be due now."""
        if self._timer is not None:
            self._timer.cancel()
        self._ring()

    def select(self, qci: int) -> bool:
        """Take the tunnel of a class from now on; False if there is none."""
        for index, way in enumerate(self._ways):
            if way.qci == qci:
                self._chosen = index
                return True
        return False

    def mark(self, topic: str, qci: int) -> bool:
        """Mark the packets of one of its ways as of a class; whether they were not before."""
        if self.settings.dscp is not None:
            # What was said about the topic counts.
            return False
        for way in self._ways:
            if way.topic == topic and not way.qci and way.marks.dscp != dscp_of(qci):
                way.marks.set(dscp=dscp_of(qci))
                return True
        return False

    # -- what it says ----------------------------------------------------------------------------

    def flows(self) -> list[UniqueTopicFlow]:
        """All that stand."""
        return [
            self._message(way, flow, UniqueTopicFlow.PRESENT)
            for way in self._ways
            for flow in way.flows.all
        ]

    def _message(
        self, way: _Way, flow: FiveTuple, event: UniqueTopicFlow.EventType.ValueType
    ) -> UniqueTopicFlow:
        targets = () if way.publisher is None else way.publisher.targets
        names = {target.port: target.node for target in targets}
        return flow_message(
            UniqueTopicFlow(
                event_type=event,
                topic=way.topic,
                source_topic=self.wanted.source,
                msg_type=self.wanted.msg_type,
                subscriber=names.get(flow.destination_port, ""),
                is_tunnel=self.is_tunnel,
                tunnel_qci=way.qci,
                dscp=way.marks.dscp or 0,
            ),
            flow,
            self.profile,
        )

    def stats(self) -> list[UniqueTopicFlowStat]:
        """What each of its ways sends: all but the one that is taken send nothing."""
        now_s = self._loop.time()
        traffic = self.meter.traffic(now_s)
        needed_ms = delay_needed_ms(traffic.rate_hz, self.profile)
        throttle = self.throttle
        chosen = self._ways[self._chosen]
        whole = UniqueTopicFlowStat(
            topic=chosen.topic,
            start_s=self._start_s,
            num_messages=self.meter.messages,
            num_bytes=self.meter.bytes,
            window_duration_s=traffic.duration_s,
            window_bandwidth=traffic.bandwidth,
            window_rate=traffic.rate_hz,
            window_average_delta=traffic.delta_s,
            window_jitter=traffic.jitter_s,
            window_burst=self.meter.burst(_BURST_SHARE * needed_ms / 1000),
            burst_ms=needed_ms,
            throttled=throttle.dropped + throttle.overflowed,
            delayed=throttle.held,
            drop_every_nth=throttle.settings.drop_every_nth,
            message_delay=throttle.settings.delay_messages,
            delay_ms=throttle.settings.delay_ms,
        )
        idle = [
            UniqueTopicFlowStat(topic=way.topic, start_s=self._start_s, num_messages=way.sent)
            for way in self._ways
            if way is not chosen
        ]
        return [whole, *idle]
