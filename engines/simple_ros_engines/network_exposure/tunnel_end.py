"""Where a topic comes out of its tunnels: in order, measured, as the type it had."""

from __future__ import annotations

import asyncio
import logging
import re
import time
from functools import partial
from typing import Any

from simple_ros.errors import SimpleRosError
from simple_ros.msg.network_exposure_msgs import UniqueTopicFlowTunnelStat
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher
from simple_ros.qos import QosProfile
from simple_ros.subscriber import Subscriber
from simple_ros_engines.network_exposure.raw import Raw, raw_class
from simple_ros_engines.network_exposure.relayed import TAKES_ANY, LargeSerialized
from simple_ros_engines.network_exposure.reorder import Arrival, Reorder, TunnelMeter

__all__ = ["TunnelEnd"]

logger = logging.getLogger(__name__)

_MOST_EARLY = 100
_TYPE = re.compile(r"[A-Za-z_][\w.]{0,199}")


class TunnelEnd:
    """Takes one topic out of its tunnels.

    Args:
        node: The relay's.
        topic: Where it comes out.
        order: Puts messages in order.
        window_s: Of the statistics.

    Attributes:
        malformed: Messages left out because they are of another type, or of none.
    """

    def __init__(self, node: NodeHandle, topic: str, order: Reorder[Raw], window_s: float) -> None:
        self.topic = topic
        self.order = order
        self.meter = TunnelMeter(window_s)
        self.malformed = 0
        self._node = node
        self._subscribers: dict[str, Subscriber[Any]] = {}
        self._publisher: Publisher[Raw] | None = None
        self._advertising: asyncio.Task[None] | None = None
        self._early: list[Raw] = []
        self._timer: asyncio.TimerHandle | None = None
        self._loop = asyncio.get_running_loop()
        self._qci = 0
        self._msg_type = ""

    async def follow(self, tunnels: dict[str, int]) -> None:
        """Subscribe to tunnels that are new, with their classes; leave those that are gone."""
        for topic in self._subscribers.keys() - tunnels.keys():
            await self._subscribers.pop(topic).close()
        for topic, qci in tunnels.items():
            if topic not in self._subscribers:
                self._subscribers[topic] = await self._node.subscribe(
                    topic, LargeSerialized, partial(self._came, qci), qos=TAKES_ANY
                )

    async def close(self) -> None:
        """End it."""
        if self._timer is not None:
            self._timer.cancel()
        if self._advertising is not None:
            self._advertising.cancel()
            await asyncio.gather(self._advertising, return_exceptions=True)
        await self.follow({})
        if self._publisher is not None:
            await self._publisher.close()

    def _came(self, qci: int, message: Any) -> None:
        head, now_s = message.fields, self._loop.time()
        if not self._is_of_this_topic(head.message_type):
            self._leave_out(head.message_type)
            return
        duplicates = self.order.duplicates
        raw = raw_class(head.message_type)(message.data)
        ready = self.order.put(Arrival(head.session, head.msg_num, raw), now_s)
        if self.order.duplicates == duplicates:
            latency_s = (time.time_ns() - head.sent_ns) / 1e9
            self.meter.came(head.session, head.msg_num, head.throttled, latency_s, now_s)
        self._qci = qci
        self._give(ready)
        self._schedule()

    def _schedule(self) -> None:
        due_s = self.order.next_due_s()
        if due_s is not None and self._timer is None:
            self._timer = self._loop.call_at(due_s, self._ring)

    def _ring(self) -> None:
        self._timer = None
        self._give(self.order.due(self._loop.time()))
        self._schedule()

    def _give(self, messages: list[Raw]) -> None:
        for message in messages:
            publisher = self._publisher
            if publisher is None:
                self._keep(message)
            else:
                publisher.publish(message)

    def _is_of_this_topic(self, msg_type: str) -> bool:
        """The first message says of what type the topic is; all others must be of the same."""
        if not self._msg_type and _TYPE.fullmatch(msg_type):
            self._msg_type = msg_type
        return bool(msg_type) and msg_type == self._msg_type

    def _leave_out(self, msg_type: str) -> None:
        self.malformed += 1
        if self.malformed == 1:
            carried = self._msg_type or "no type yet"
            logger.warning("%s carries %s, not %.100r: left out", self.topic, carried, msg_type)

    def _keep(self, message: Raw) -> None:
        """The first messages wait until the topic is advertised: only they say of what type it is."""
        self._early = [*self._early, message][-_MOST_EARLY:]
        if self._advertising is None or self._advertising.done():
            self._advertising = asyncio.create_task(self._advertise(type(message)))

    async def _advertise(self, message_class: type[Raw]) -> None:
        try:
            self._publisher = await self._node.advertise(
                self.topic, message_class, qos=QosProfile(depth=100)
            )
        except SimpleRosError as error:
            logger.warning("%s cannot be advertised: %s", self.topic, error)
            return
        early, self._early = self._early, []
        self._give(early)

    def stat(self) -> UniqueTopicFlowTunnelStat:
        """What came."""
        seen = self.meter.traffic(self._loop.time())
        order = self.order
        return UniqueTopicFlowTunnelStat(
            topic=self.topic,
            received=seen.received,
            measured_latency=seen.latency_s,
            latency_p95=seen.latency_p95_s,
            measured_droprate=seen.loss_rate,
            throttle_rate=seen.throttle_rate,
            lost=seen.lost,
            throttled=seen.throttled,
            late=order.late,
            discarded=order.discarded,
            duplicates=order.duplicates,
            restarts=order.restarts,
            qci=self._qci,
            jitter=seen.jitter_s,
        )
