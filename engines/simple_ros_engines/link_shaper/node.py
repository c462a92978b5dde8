"""The link shaper's node: statistics, changes while it runs, places of robots. It takes no part in the links."""

from __future__ import annotations

import math
from functools import partial

from simple_ros.errors import ConfigError
from simple_ros.msg.geometry_msgs import PoseStamped
from simple_ros.msg.link_shaper_msgs import (
    ClassStatistics,
    GetStatistics,
    GetStatisticsRequest,
    GetStatisticsResponse,
    LinkStatistics,
    SetLink,
    SetLinkRequest,
    SetLinkResponse,
    ShaperStatistics,
)
from simple_ros.node import NodeHandle
from simple_ros.qos import QosProfile
from simple_ros_engines.link_shaper.relay import Relay
from simple_ros_engines.simulator.shaper import LinkShaper
from simple_ros_engines.simulator.shaper_queue import ClassCounts, DirectionQueue
from simple_ros_engines.simulator.shaper_settings import DIRECTIONS

__all__ = ["NODE", "ShaperNode", "statistics"]

NODE = "link_shaper"
_EVERY_S = 0.5


class ShaperNode:
    """Tells and is told about a relay.

    Args:
        relay: It.
    """

    def __init__(self, relay: Relay) -> None:
        self._relay = relay
        self._seq = 0

    async def run(self, node: NodeHandle) -> None:
        """Work until cancelled or the node ends."""
        await node.advertise_service(f"/{NODE}/set_link", SetLink, self._set)
        await node.advertise_service(f"/{NODE}/get_statistics", GetStatistics, self._get)
        self._told = await node.advertise(
            f"/{NODE}/statistics", ShaperStatistics, qos=QosProfile(depth=10)
        )
        for name, link in self._relay.machine.settings.links.items():
            if link.pose_topic:
                moved = partial(self._moved, name)
                await node.subscribe(link.pose_topic, PoseStamped, moved)
        node.create_timer(_EVERY_S, lambda _: self._tell(node))
        await node.spin()

    def _moved(self, link: str, pose: PoseStamped) -> None:
        at = pose.pose.position
        if math.isfinite(at.x) and math.isfinite(at.y):
            self._relay.machine.moved_to(link, at.x, at.y)

    def _tell(self, node: NodeHandle) -> None:
        if self._told.subscriber_count:
            self._relay.catch_up()
            message = statistics(self._relay.machine)
            message.header.seq = self._seq
            message.header.stamp.FromNanoseconds(node.clock.now().nanoseconds)
            self._seq += 1
            self._told.publish(message)

    async def _get(self, request: GetStatisticsRequest) -> GetStatisticsResponse:  # noqa: ARG002
        self._relay.catch_up()
        return GetStatisticsResponse(statistics=statistics(self._relay.machine))

    async def _set(self, request: SetLinkRequest) -> SetLinkResponse:
        now_s = self._relay.catch_up()
        try:
            self._relay.machine.change(
                request.link, request.direction, dict(request.changes), now_s
            )
        except ConfigError as error:
            return SetLinkResponse(message=str(error))
        self._relay.pump()
        return SetLinkResponse(ok=True)


def statistics(machine: LinkShaper) -> ShaperStatistics:
    """Everything that is known of the links now."""
    result = ShaperStatistics(seed=machine.settings.seed)
    for link, way, queue in machine.queues():
        result.links.append(_link(machine, link, way, queue))
    return result


def _link(machine: LinkShaper, link: str, way: str, queue: DirectionQueue) -> LinkStatistics:
    conditions = queue.conditions
    message = LinkStatistics(
        link=link,
        direction=way,
        rate_bps=conditions.rate_bps,
        delay_ms=1000 * conditions.delay_s,
        jitter_ms=1000 * conditions.jitter_s,
        loss=conditions.loss,
        min_share=conditions.min_share,
        max_share=conditions.max_share,
        share=queue.share,
    )
    for item, counts, waiting in zip(
        machine.settings.classes, queue.counts, queue.waiting_bytes, strict=True
    ):
        message.classes.append(_class(item.name, counts, waiting))
    sample = machine.sample(link)
    if sample is not None and sample.sides[DIRECTIONS[0]].snr_db is not None:
        side = sample.sides[way]
        message.has_radio = True
        message.snr_db, message.mcs, message.bler = (
            side.snr_db or 0.0,
            side.mcs or 0,
            side.bler or 0.0,
        )
        message.x_m, message.y_m = sample.position_m or (0.0, 0.0)
    return message


def _class(name: str, counts: ClassCounts, waiting_bytes: int) -> ClassStatistics:
    message = ClassStatistics(
        name=name,
        offered=counts.offered,
        offered_bytes=counts.offered_bytes,
        delivered=counts.delivered,
        delivered_bytes=counts.delivered_bytes,
        late=counts.late,
        dropped=counts.dropped,
        lost=counts.lost,
        expired=counts.expired,
        waiting_bytes=waiting_bytes,
    )
    if counts.latencies_s:
        message.latency_p50_ms = 1000 * counts.latency_s(0.5)
        message.latency_p99_ms = 1000 * counts.latency_s(0.99)
        message.latency_max_ms = 1000 * max(counts.latencies_s)
    return message
