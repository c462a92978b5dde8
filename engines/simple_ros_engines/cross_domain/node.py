"""The Cross Domain Engine as a node."""

from __future__ import annotations

import asyncio
import logging
import math
import time
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from simple_ros.aio import ServerGoal
from simple_ros.msg.arrays import numpy_to_occupancy_grid, occupancy_grid_to_numpy
from simple_ros.msg.geometry_msgs import Pose, PoseStamped, Quaternion
from simple_ros.msg.nav_msgs import OccupancyGrid, Path
from simple_ros.msg.std_msgs import Float32, String
from simple_ros.msg.wireless_ros_msgs import (
    Constraint,
    EnhanceMap,
    EnhanceMapFeedback,
    EnhanceMapGoal,
    EnhanceMapResult,
    OptimizePath,
    OptimizePathRequest,
    OptimizePathResponse,
    PhyLayerMetrics,
)
from simple_ros.msg.wireless_ros_msgs import PathQuality as PathQualityMessage
from simple_ros.node import NodeHandle
from simple_ros.qos import Durability, QosProfile
from simple_ros_engines.base import NAMESPACE, WirelessEngine, outlet
from simple_ros_engines.cross_domain.core import CrossDomain, Decision, LinkMetrics
from simple_ros_engines.cross_domain.path import (
    PathQuality,
    PathWeights,
    analyze_path,
    plan_between,
)
from simple_ros_engines.cross_domain.quality_map import GridFrame, QualityMap, enhanced_cells
from simple_ros_engines.physical_adaptive.strategy import RECOMMENDATIONS

__all__ = ["CrossDomainEngine"]

logger = logging.getLogger(__name__)

_LATCHED = QosProfile(depth=1, durability=Durability.TRANSIENT_LOCAL)
_ENHANCE_EVERY_S = 5.0


class CrossDomainEngine(WirelessEngine[PhyLayerMetrics]):
    """Turns what is known of links into constraints, and into maps and ways that know the radio.

    Parameters besides the common ones: ``link`` (the robot's own link; empty takes the only one there is),
    ``comm_weight``, ``task_deadline_ms`` (0: none).
    """

    node_name: ClassVar[str] = f"{NAMESPACE}/cross_domain_engine"
    summary: ClassVar[str] = "What radio links mean for a robot: constraints, maps, ways."
    update_interval_s = 0.2

    def __init__(self) -> None:
        super().__init__()
        self.core = CrossDomain()
        self.map: OccupancyGrid | None = None
        self.quality: QualityMap | None = None
        self.newest: dict[str, PhyLayerMetrics] = {}
        self._own_link = ""

    async def set_up(self, node: NodeHandle) -> None:
        """Declare, advertise, subscribe, provide."""
        await self._declare(node)
        self._constraints = await outlet(node, "constraints", Constraint, 100)
        self._texts = {
            name: await node.advertise(f"/{NAMESPACE}/{name}", String)
            for name in ("network_quality", "sensor_mode", "adaptation_recommendation")
        }
        self._numbers = {
            name: await node.advertise(f"/{NAMESPACE}/{name}", Float32)
            for name in (
                "latency_estimate",
                "bandwidth_estimate",
                "reliability_score",
                "task_criticality",
                "compression_level",
            )
        }
        self._enhanced = await node.advertise(
            f"/{NAMESPACE}/enhanced_map", OccupancyGrid, qos=_LATCHED
        )
        self._way = await node.advertise(f"/{NAMESPACE}/comm_aware_path", Path, qos=_LATCHED)
        await self._subscribe(node)
        await node.advertise_service(
            f"/{NAMESPACE}/optimize_path", OptimizePath, self._optimize_path
        )
        await node.advertise_action(f"/{NAMESPACE}/enhance_map", EnhanceMap, self._enhance)
        node.create_timer(_ENHANCE_EVERY_S, lambda _: self._publish_enhanced())

    async def _declare(self, node: NodeHandle) -> None:
        self._own_link = str(await node.declare_parameter("~link", ""))
        await node.declare_parameter("~comm_weight", 2.0, minimum=0.0, maximum=100.0)
        deadline = await node.declare_parameter("~task_deadline_ms", 0.0, minimum=0.0)
        self.core.deadline_ms = float(deadline) or None
        node.on_parameter_changed("~link", self._link_changed)
        node.on_parameter_changed("~task_deadline_ms", self._deadline_changed)
        self._node = node

    def _link_changed(self, value: object) -> None:
        self._own_link = str(value)

    def _deadline_changed(self, value: object) -> None:
        self.core.deadline_ms = float(str(value)) or None

    async def _subscribe(self, node: NodeHandle) -> None:
        await node.subscribe(f"/{NAMESPACE}/phy_layer_metrics", PhyLayerMetrics, self._came)
        await node.subscribe("/task_status", String, self._task_status)
        await node.subscribe("/robot/pose", PoseStamped, self._pose)
        await node.subscribe("/map", OccupancyGrid, self._map_came, qos=_LATCHED)
        await node.subscribe("/planned_path", Path, self._path_came)

    def link_count(self) -> int:
        """Links with a decision."""
        return self.core.link_count()

    def _came(self, message: PhyLayerMetrics) -> None:
        self.newest[message.link_id] = message
        self.offer(message.link_id, message)

    def _task_status(self, message: String) -> None:
        self.core.criticality.status(message.data)

    def priority(self, item: PhyLayerMetrics) -> float:
        """Bad links go first."""
        return 1.0 - item.link_quality

    def differs(self, before: PhyLayerMetrics, now: PhyLayerMetrics) -> bool:
        """Whether quality, reliability or rate moved."""
        return (
            abs(before.link_quality - now.link_quality) > 0.01
            or abs(before.reliability - now.reliability) > 0.01
            or abs(before.available_bps - now.available_bps) > 0.05 * before.available_bps
        )

    def look_at(self, item: PhyLayerMetrics) -> None:
        """Decide for a link and tell."""
        metrics = LinkMetrics(
            item.link_id,
            item.link_quality,
            item.reliability,
            item.channel_response_time or None,
            item.available_bps or None,
        )
        decision = self.core.decide(metrics)
        limits = decision.limits
        message = Constraint(
            rnti=item.rnti,
            link_id=item.link_id,
            max_data_rate=limits.max_rate_bps / 1e6,
            min_quality=limits.min_quality,
            max_latency=limits.max_latency_ms,
            expected_latency_ms=limits.expected_latency_ms,
            drop_non_essential=limits.drop_non_essential,
            frame_rate=limits.frame_rate,
            resolution_scale=limits.resolution_scale,
            constraint_type=limits.kind,
            criticality=decision.criticality,
        )
        message.header.stamp.CopyFrom(item.header.stamp)
        self._constraints.publish(message)
        if item.link_id == self._link():
            self._tell(item, decision)

    def _tell(self, item: PhyLayerMetrics, decision: Decision) -> None:
        """The robot's own link, on topics that know no links."""
        texts = {
            "network_quality": decision.level,
            "sensor_mode": decision.sensor_mode,
            "adaptation_recommendation": RECOMMENDATIONS[decision.level],
        }
        numbers = {
            "latency_estimate": item.channel_response_time,
            "bandwidth_estimate": item.available_bps / 1e6,
            "reliability_score": item.reliability,
            "task_criticality": decision.criticality,
            "compression_level": decision.compression,
        }
        for name, text in texts.items():
            if self._texts[name].subscriber_count:
                self._texts[name].publish(String(data=text))
        for name, number in numbers.items():
            if self._numbers[name].subscriber_count:
                self._numbers[name].publish(Float32(data=number))

    def _link(self) -> str:
        """The robot's own link; the only one there is, if none was named."""
        if self._own_link or len(self.newest) != 1:
            return self._own_link
        return next(iter(self.newest))

    # -- maps and ways ---------------------------------------------------------------------------

    def _map_came(self, message: OccupancyGrid) -> None:
        frame = _frame(message)
        if frame is None:
            logger.warning("a map without cells or resolution came; it is not used")
            return
        if self.quality is None:
            self.quality = QualityMap(frame)
        elif self.quality.frame != frame:
            self.quality = self.quality.moved(frame)
        self.map = message

    def _pose(self, message: PoseStamped) -> None:
        metrics = self.newest.get(self._link())
        if metrics is not None and self.quality is not None:
            at = message.pose.position
            self.quality.update(at.x, at.y, metrics.link_quality, time.monotonic())

    def _path_came(self, message: Path) -> None:
        response = self._better_way(message, 0.0)
        if response.success:
            self._way.publish(response.path)
        if response.before.dead_zone_m:
            logger.warning("the planned path: %s", response.message)

    def _publish_enhanced(self) -> None:
        if self.map is not None and self._enhanced.subscriber_count:
            self._enhanced.publish(self._with_quality(self.map))

    def _with_quality(self, grid: OccupancyGrid) -> OccupancyGrid:
        assert self.quality is not None
        frame = _frame(grid)
        same = frame is None or frame == self.quality.frame
        quality = self.quality if same or frame is None else self.quality.moved(frame)
        cells = enhanced_cells(occupancy_grid_to_numpy(grid), quality.quality)
        return numpy_to_occupancy_grid(
            cells, grid.info.resolution, origin=grid.info.origin, header=grid.header
        )

    async def _optimize_path(self, request: OptimizePathRequest) -> OptimizePathResponse:
        # Planning takes a while on a large map; metrics must not wait for it.
        return await asyncio.to_thread(self._better_way, request.path, request.weight)

    def _better_way(self, path: Path, weight: float) -> OptimizePathResponse:
        grid, quality = self.map, self.quality
        if grid is None or quality is None:
            return OptimizePathResponse(message="there is no map yet (topic /map)")
        points = [(pose.pose.position.x, pose.pose.position.y) for pose in path.poses]
        if len(points) < 2:
            return OptimizePathResponse(message="a path needs two poses or more")
        before = analyze_path(points, quality)
        wanted = weight or float(self._node.parameters["~comm_weight"])
        cells: NDArray[np.int8] = occupancy_grid_to_numpy(grid)
        way = plan_between(cells, quality, points[0], points[-1], PathWeights(wanted))
        if way is None:
            text = "an end is outside the map or in an obstacle, or no way leads there"
            return OptimizePathResponse(message=text, before=_quality_message(before))
        after = analyze_path(way, quality)
        return OptimizePathResponse(
            success=True,
            message=_told(before, after),
            path=_path_message(path, way),
            before=_quality_message(before),
            after=_quality_message(after),
        )

    async def _enhance(
        self, goal: ServerGoal[EnhanceMapGoal, EnhanceMapResult, EnhanceMapFeedback]
    ) -> EnhanceMapResult:
        given = goal.goal.map
        grid = given if given.data else self.map
        if grid is None or _frame(grid) is None:
            goal.abort(EnhanceMapResult(), "there is no map")
            return EnhanceMapResult()
        if self.quality is None:
            self._map_came(grid)
        assert self.quality is not None
        result = self._with_quality(grid)
        goal.publish_feedback(EnhanceMapFeedback(progress=1.0))
        return EnhanceMapResult(map=result, known_cells=self.quality.known_cells())


def _frame(grid: OccupancyGrid) -> GridFrame | None:
    info = grid.info
    if not (info.width and info.height and info.resolution > 0):
        return None
    if len(grid.data) != info.width * info.height:
        return None
    turn: Quaternion = info.origin.orientation
    yaw = math.atan2(
        2 * (turn.w * turn.z + turn.x * turn.y), 1 - 2 * (turn.y * turn.y + turn.z * turn.z)
    )
    at = info.origin.position
    return GridFrame(info.width, info.height, info.resolution, at.x, at.y, yaw)


def _quality_message(quality: PathQuality) -> PathQualityMessage:
    return PathQualityMessage(
        length_m=quality.length_m,
        mean=quality.mean,
        minimum=quality.minimum,
        dead_zone_m=quality.dead_zone_m,
        unknown_m=quality.unknown_m,
    )


def _path_message(path: Path, way: list[tuple[float, float]]) -> Path:
    result = Path(header=path.header)
    last = path.poses[-1].pose
    for index, (x, y) in enumerate(way):
        following = way[min(index + 1, len(way) - 1)]
        pose = Pose()
        pose.position.x, pose.position.y = x, y
        if index == len(way) - 1:
            pose.orientation.CopyFrom(last.orientation)
        else:
            yaw = math.atan2(following[1] - y, following[0] - x)
            pose.orientation.z, pose.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)
        result.poses.append(PoseStamped(header=path.header, pose=pose))
    return result


def _told(before: PathQuality, after: PathQuality) -> str:
    return (
        f"quality mean {before.mean:.2f} -> {after.mean:.2f}, "
        f"least {before.minimum:.2f} -> {after.minimum:.2f}, "
        f"in dead zones {before.dead_zone_m:.1f} m -> {after.dead_zone_m:.1f} m, "
        f"length {before.length_m:.1f} m -> {after.length_m:.1f} m"
    )
