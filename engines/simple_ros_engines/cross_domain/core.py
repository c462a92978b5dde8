"""What follows from a link's metrics for a robot: everything the Cross Domain Engine tells. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from simple_ros_engines.cross_domain.constraints import (
    LevelJudge,
    Limits,
    TaskCriticality,
    constrain,
    network_score,
)
from simple_ros_engines.cross_domain.sensing import CompressionJudge, SensorModeJudge

__all__ = ["CrossDomain", "Decision", "LinkMetrics"]

LEAST_BPS = 1e5


@dataclass(frozen=True, slots=True)
class LinkMetrics:
    """What is known of a link.

    Attributes:
        link_id: Key of the link.
        quality: 0..1.
        reliability: 0..1.
        latency_ms: Round trip; None while unknown.
        bandwidth_bps: What it can carry; None while unknown.
    """

    link_id: str
    quality: float
    reliability: float
    latency_ms: float | None
    bandwidth_bps: float | None


@dataclass(frozen=True, slots=True)
class Decision:
    """What follows.

    Attributes:
        level: Of the network.
        limits: The constraint.
        sensor_mode: For the sensors.
        compression: Level, 0 to 0.9.
        criticality: Of the task.
    """

    level: str
    limits: Limits
    sensor_mode: str
    compression: float
    criticality: float


class _Link:
    def __init__(self) -> None:
        self.level = LevelJudge()
        self.mode = SensorModeJudge()
        self.compression = CompressionJudge()


class CrossDomain:
    """Decides for all links of one robot.

    Attributes:
        criticality: Of the present task.
        deadline_ms: Latency the task needs; None if it did not say.
        active_sensors: How many sensors share the link; 0 if nobody tells, then one is assumed.
    """

    def __init__(self) -> None:
        self.criticality = TaskCriticality()
        self.deadline_ms: float | None = None
        self.active_sensors = 0
        self._links: dict[str, _Link] = {}

    def link_count(self) -> int:
        """How many links it knows."""
        return len(self._links)

    def forget(self, link_id: str) -> None:
        """Keep nothing of a link that is gone."""
        self._links.pop(link_id, None)

    def decide(self, metrics: LinkMetrics) -> Decision:
        """What follows from the newest metrics of a link."""
        link = self._links.get(metrics.link_id)
        if link is None:
            link = self._links[metrics.link_id] = _Link()
        bandwidth = LEAST_BPS if metrics.bandwidth_bps is None else metrics.bandwidth_bps
        level = link.level.judge(network_score(metrics.quality, metrics.reliability))
        self.criticality.level(level)
        criticality = self.criticality.value
        limits = constrain(
            level,
            bandwidth_bps=bandwidth,
            latency_ms=20.0 if metrics.latency_ms is None else metrics.latency_ms,
            reliability=metrics.reliability,
            criticality=criticality,
            deadline_ms=self.deadline_ms,
        )
        return Decision(
            level,
            limits,
            link.mode.judge(level, bandwidth / max(1, self.active_sensors), criticality),
            link.compression.judge(bandwidth, metrics.quality, criticality),
            criticality,
        )
