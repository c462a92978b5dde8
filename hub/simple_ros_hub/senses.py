"""What the hub hears: signs of life, and the topics of the engines."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator
from typing import Any, TypeVar

from google.protobuf.message import Message

from simple_ros.diagnostics.status import OK
from simple_ros.msg.wireless_ros_msgs import (
    CellStatus,
    ChannelState,
    Constraint,
    EngineStatus,
    PhyLayerMetrics,
    TransmissionStrategy,
)
from simple_ros.node import NodeHandle
from simple_ros.qos import QosProfile
from simple_ros_hub.components import NAMESPACE
from simple_ros_hub.coordination import Coordinator
from simple_ros_hub.signs import Signs
from simple_ros_hub.watchdog import TopicWatchdog

__all__ = ["Senses"]

MessageT = TypeVar("MessageT", bound=Message)

_TOPICS = {
    "radio_info_engine": ("channel_state", "phy_layer_metrics"),
    "cross_domain_engine": ("constraints",),
    "physical_adaptive_engine": ("transmission_strategy",),
}


class Senses:
    """Subscribes and hands on.

    Args:
        node: The hub's.
        coordinator: Gets what is told of links.
        heard: Called with a component's name and its sign of life.
        period_s: Expected between messages of the engines.
        ours: Names of the components that are looked after.

    Attributes:
        signs: The newest sign of life of each component.
        cells: The newest status of each cell that is looked after, by name.
        watchdogs: By topic.
        channels: The newest state of each link, by key.
    """

    def __init__(
        self,
        node: NodeHandle,
        coordinator: Coordinator,
        heard: Callable[[str, EngineStatus], None],
        period_s: float,
        ours: Collection[str],
    ) -> None:
        self.signs = Signs(ours)
        self.cells: dict[str, CellStatus] = {}
        self.watchdogs: dict[str, TopicWatchdog] = {}
        self.channels: dict[str, ChannelState] = {}
        self._node = node
        self._coordinator = coordinator
        self._heard = heard
        self._period_s = period_s
        self._ours = ours

    async def open(self) -> None:
        """Subscribe."""
        links = self._coordinator
        qos = QosProfile(depth=1000)
        await self._node.subscribe(f"/{NAMESPACE}/status", EngineStatus, self._status, qos=qos)
        await self._node.subscribe(f"/{NAMESPACE}/cell_status", CellStatus, self._cell, qos=qos)
        await self._watch("channel_state", ChannelState, self._channel)
        await self._watch("phy_layer_metrics", PhyLayerMetrics, links.metrics)
        await self._watch("constraints", Constraint, links.constraint)
        await self._watch("transmission_strategy", TransmissionStrategy, links.strategy)

    async def _watch(
        self, topic: str, kind: type[MessageT], take: Callable[[MessageT, float], None]
    ) -> None:
        name = f"/{NAMESPACE}/{topic}"
        watchdog = self.watchdogs[topic] = TopicWatchdog(name, self._period_s, time.monotonic())

        def came(message: Any) -> None:
            now_s = time.monotonic()
            seq = message.header.seq
            several = subscriber.publisher_count > 1
            watchdog.message(message.ByteSize(), now_s, seq, several=several)
            take(message, now_s)

        subscriber = await self._node.subscribe(name, kind, came, qos=QosProfile(depth=1000))

    def _status(self, message: EngineStatus) -> None:
        name = message.name.strip("/").removeprefix(f"{NAMESPACE}/")
        self.signs.came(name, message, time.monotonic())
        self._heard(name, message)

    def _channel(self, message: ChannelState, now_s: float) -> None:
        self.channels[message.link_id] = message
        self._coordinator.channel(message, now_s)

    def _cell(self, message: CellStatus) -> None:
        if message.name in self._ours:
            self.cells[message.name] = message

    def began(self, component: str) -> None:
        """A component was started (again)."""
        for topic in _TOPICS.get(component, ()):
            self.watchdogs[topic].begins_anew()

    def look(self, working: Collection[str]) -> Iterator[tuple[str, str]]:
        """Topics, and what is wrong with each; an empty text if nothing is.

        Args:
            working: Names of the components that ought to have something to tell.
        """
        now_s = time.monotonic()
        self.signs.forget(now_s)
        for key in self.channels.keys() - self._coordinator.newest_metrics.keys():
            del self.channels[key]
        flows = True
        for sender, topics in _TOPICS.items():
            flows = flows and sender in working
            for topic in topics:
                finding = self.watchdogs[topic].look(now_s, needed=flows)
                yield topic, "" if finding.level == OK else finding.text
                # What comes after it in the chain cannot flow either: one fault, one event.
                flows = flows and bool(finding.facts.messages)

    @property
    def came(self) -> int:
        """Messages of all watched topics."""
        return sum(watchdog.messages for watchdog in self.watchdogs.values())

    @property
    def missing(self) -> int:
        """Of these, those that never came."""
        return sum(watchdog.gaps for watchdog in self.watchdogs.values())
