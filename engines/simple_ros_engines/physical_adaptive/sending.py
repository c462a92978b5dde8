"""Actuators where data is sent: application rate, JPEG quality, voxels, topic priority with DSCP on live sockets.

They belong into the node that sends: the topic bridge has them, and any node may:

    ways, marks = marked(node.transports)
    publisher = await node.advertise("scan", LaserScan, transports=ways)
    gate = RateGate()
    await StrategyApplier(node, [PriorityActuator(marks), RateActuator(gate.limit, lambda: 4000)]).start()
    ...
    if gate.passes(loop.time()):
        publisher.publish(scan)
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import ClassVar

from simple_ros.errors import ConfigError
from simple_ros.msg.wireless_ros_msgs import ActuationReport, TransmissionStrategy
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher
from simple_ros.qos import QosProfile
from simple_ros_engines.base import NAMESPACE
from simple_ros_engines.cross_domain.mappings import map_task_priority_to_qos
from simple_ros_engines.cross_domain.sensing import jpeg_quality, voxel_leaf_m
from simple_ros_engines.marking import Marks
from simple_ros_engines.own_link import is_meant
from simple_ros_engines.physical_adaptive.actuators import Actuator, Applied
from simple_ros_engines.physical_adaptive.strategy import Strategy

__all__ = [
    "JpegActuator",
    "PriorityActuator",
    "RateActuator",
    "StrategyApplier",
    "VoxelActuator",
    "applied_by",
    "report_of",
]

logger = logging.getLogger(__name__)


class RateActuator(Actuator):
    """The application rate: how many messages a second fit the strategy's bits a second.

    Args:
        set_hz: Takes the rate, messages a second.
        message_bytes: Mean size of a message now.
        share: Of the link's rate that this topic may use.
        most_hz: Never more.
    """

    name: ClassVar[str] = "application_rate"

    def __init__(
        self,
        set_hz: Callable[[float], None],
        message_bytes: Callable[[], float],
        share: float = 1.0,
        most_hz: float = 100.0,
    ) -> None:
        if not 0 < share <= 1 or most_hz <= 0:
            raise ConfigError(f"share {share} must be above 0 up to 1, most_hz {most_hz} above 0")
        self._set_hz = set_hz
        self._message_bytes = message_bytes
        self._share = share
        self._most_hz = most_hz

    def apply(self, link_id: str, rnti: int | None, strategy: Strategy) -> Applied:  # noqa: ARG002
        """Set the rate."""
        size = self._message_bytes()
        if size <= 0 or strategy.rate_bps <= 0:
            return Applied(
                False, f"{strategy.rate_bps:g} bit/s and {size:g} bytes a message: no rate"
            )
        rate_hz = min(self._most_hz, self._share * strategy.rate_bps / (8 * size))
        self._set_hz(rate_hz)
        return Applied(True, f"at most {rate_hz:.2f} messages/s")


class JpegActuator(Actuator):
    """JPEG quality from the compression ratio.

    Args:
        set_quality: Takes it, 30 to 95.
    """

    name: ClassVar[str] = "jpeg_quality"

    def __init__(self, set_quality: Callable[[int], None]) -> None:
        self._set_quality = set_quality

    def apply(self, link_id: str, rnti: int | None, strategy: Strategy) -> Applied:  # noqa: ARG002
        """Set the quality."""
        quality = jpeg_quality(strategy.compression_ratio)
        self._set_quality(quality)
        return Applied(True, f"quality {quality}")


class VoxelActuator(Actuator):
    """Edge of voxels from the compression ratio.

    Args:
        set_leaf_m: Takes it; 0: all points.
        spacing_m: Between neighbouring points of the sensor.
    """

    name: ClassVar[str] = "voxel"

    def __init__(self, set_leaf_m: Callable[[float], None], spacing_m: float = 0.05) -> None:
        self._set_leaf_m = set_leaf_m
        self._spacing_m = spacing_m

    def apply(self, link_id: str, rnti: int | None, strategy: Strategy) -> Applied:  # noqa: ARG002
        """Set the edge."""
        leaf_m = voxel_leaf_m(strategy.compression_ratio, self._spacing_m)
        self._set_leaf_m(leaf_m)
        return Applied(True, f"voxels of {leaf_m:.3f} m")


class PriorityActuator(Actuator):
    """Topic priority: code point (DSCP) and socket priority of a publisher's connections.

    What the kernel then says of them decides whether it is applied; connections to come are marked too.

    Args:
        marks: Of the publisher (`marking.marked`).
        offset: Added to the strategy's priority, for topics that matter more or less than the rest.
    """

    name: ClassVar[str] = "topic_priority"

    def __init__(self, marks: Marks, offset: int = 0) -> None:
        self._marks = marks
        self._offset = offset

    def apply(self, link_id: str, rnti: int | None, strategy: Strategy) -> Applied:  # noqa: ARG002
        """Mark the connections."""
        priority = max(1, min(5, strategy.priority + self._offset))
        dscp = map_task_priority_to_qos(priority).dscp
        found = self._marks.set(dscp=dscp, priority=priority)
        told = f"DSCP {dscp}, socket priority {priority} on {found.marked} of {found.connections}"
        ok = found.marked == found.connections and not found.problems
        return Applied(ok, "; ".join((f"{told} connections", *found.problems)))


def applied_by(actuator: Actuator, link_id: str, rnti: int | None, strategy: Strategy) -> Applied:
    """What an actuator did; if it raises, that it failed and why."""
    try:
        return actuator.apply(link_id, rnti, strategy)
    except Exception as error:
        logger.exception("actuator %s failed", actuator.name)
        return Applied(False, f"{type(error).__name__}: {error}")


def report_of(actuator: str, done: Applied, strategy: TransmissionStrategy) -> ActuationReport:
    """The acknowledgement of a strategy; it has the strategy's stamp."""
    report = ActuationReport(
        link_id=strategy.link_id, actuator=actuator, applied=done.ok, detail=done.detail
    )
    report.header.stamp.CopyFrom(strategy.header.stamp)
    return report


def strategy_of(message: TransmissionStrategy) -> Strategy:
    """A strategy from its message."""
    return Strategy(
        message.target_mcs,
        message.target_prb,
        message.compression_ratio,
        message.priority,
        message.retransmission_enabled,
        message.max_harq_retx,
        message.strategy_type,
        message.rate_bps,
        message.action,
    )


class StrategyApplier:
    """Applies the strategies of a link in the node that sends over it, and acknowledges each.

    Args:
        node: The sender's.
        actuators: What to do.
        link: Only strategies of this link; empty: of any.
        prefix: Of the actuators' names in reports.
    """

    def __init__(
        self, node: NodeHandle, actuators: Sequence[Actuator], link: str = "", prefix: str = ""
    ) -> None:
        self.actuators = list(actuators)
        self._node = node
        self._link = link
        self._prefix = prefix
        self._reports: Publisher[ActuationReport] | None = None

    async def start(self) -> None:
        """Subscribe to strategies, advertise reports."""
        self._reports = await self._node.advertise(
            f"/{NAMESPACE}/actuation_report", ActuationReport, qos=QosProfile(depth=100)
        )
        await self._node.subscribe(
            f"/{NAMESPACE}/transmission_strategy", TransmissionStrategy, self._came
        )

    def _came(self, message: TransmissionStrategy) -> None:
        if not is_meant(self._link, message.link_id):
            return
        strategy = strategy_of(message)
        for actuator in self.actuators:
            done = applied_by(actuator, message.link_id, message.rnti or None, strategy)
            assert self._reports is not None
            self._reports.publish(report_of(self._prefix + actuator.name, done, message))
