"""The Cross Domain Engine as a node."""

from __future__ import annotations

import asyncio
import logging
import time
from typing import ClassVar

from simple_ros.aio import ServerGoal
from simple_ros.msg.arrays import numpy_to_occupancy_grid, occupancy_grid_to_numpy
from simple_ros.msg.geometry_msgs import PoseStamped, TwistStamped
from simple_ros.msg.nav_msgs import OccupancyGrid, Path
from simple_ros.msg.std_msgs import Float32, String
from simple_ros.msg.visualization_msgs import MarkerArray
from simple_ros.msg.wireless_ros_msgs import (
    ActuationReport,
    Constraint,
    ControlLimits,
    EnhanceMap,
    EnhanceMapFeedback,
    EnhanceMapGoal,
    EnhanceMapResult,
    OptimizePath,
    OptimizePathRequest,
    OptimizePathResponse,
    PhyLayerMetrics,
)
from simple_ros.node import NodeHandle
from simple_ros.qos import Durability, QosProfile
from simple_ros_engines.base import NAMESPACE, WirelessEngine, outlet
from simple_ros_engines.cross_domain.core import CrossDomain, Decision, LinkMetrics
from simple_ros_engines.cross_domain.mappings import convert_network_metrics_to_control_limits
from simple_ros_engines.cross_domain.navigation import (
    NAV_FIELDS,
    NavigationClient,
    nav_parameter_names,
)
from simple_ros_engines.cross_domain.quality_map import QualityMap, enhanced_cells
from simple_ros_engines.cross_domain.robot_state import RobotState
from simple_ros_engines.cross_domain.ways import MOST_WEIGHT, better_way, frame_of
from simple_ros_engines.health import report_health
from simple_ros_engines.mapping_parameter import declare_mapping
from simple_ros_engines.own_link import OwnLink
from simple_ros_engines.physical_adaptive.strategy import RECOMMENDATIONS

__all__ = ["CrossDomainEngine"]

logger = logging.getLogger(__name__)

_LATCHED = QosProfile(depth=1, durability=Durability.TRANSIENT_LOCAL)
_ENHANCE_EVERY_S = 5.0
_FRESH_S = 2.0
_FORGET_S = 3600.0


class CrossDomainEngine(WirelessEngine[PhyLayerMetrics]):
    """Turns what is known of links into constraints, and into maps and ways that know the radio.

    Parameters besides the common ones: ``link`` (the robot's own link; empty takes the only one there is),
    ``comm_weight``, ``task_deadline_ms`` (0: none), ``navigation_parameters`` (JSON: field of
    `mappings.NavParams` to the name of a parameter of the navigation stack), ``plan_service`` (its planner, of
    type nav_msgs/GetPlan), ``max_vel_mps``, ``safe_distance_m``.
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
        self.robot = RobotState()
        self._own = OwnLink()
        self._heard_s: dict[str, float] = {}
        self._safe_m = 1.0
        self._planned: Path | None = None
        self._planning: asyncio.Task[None] | None = None

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
        self._limits = await outlet(node, "control_limits", ControlLimits)
        # Before anything comes: a decision is handed to the navigation stack, too.
        await self._meet_navigation(node)
        await self._subscribe(node)
        await report_health(node, self)
        await node.advertise_service(
            f"/{NAMESPACE}/optimize_path", OptimizePath, self._optimize_path
        )
        await node.advertise_action(f"/{NAMESPACE}/enhance_map", EnhanceMap, self._enhance)
        node.create_timer(_ENHANCE_EVERY_S, lambda _: self._publish_enhanced())
        node.create_timer(_FORGET_S / 60, lambda _: self._forget_silent())

    async def _declare(self, node: NodeHandle) -> None:
        self._own.name = str(await node.declare_parameter("~link", ""))
        await node.declare_parameter("~comm_weight", 2.0, minimum=0.0, maximum=MOST_WEIGHT)
        deadline = await node.declare_parameter("~task_deadline_ms", 0.0, minimum=0.0)
        self.core.deadline_ms = float(deadline) or None
        node.on_parameter_changed("~link", self._link_changed)
        node.on_parameter_changed("~task_deadline_ms", self._deadline_changed)
        self._node = node

    async def _meet_navigation(self, node: NodeHandle) -> None:
        get = node.declare_parameter
        names = nav_parameter_names(
            await declare_mapping(node, "~navigation_parameters", NAV_FIELDS)
        )
        service = str(await get("~plan_service", "", read_only=True))
        speed = float(await get("~max_vel_mps", 1.5, minimum=0.01, maximum=50, read_only=True))
        self._safe_m = float(await get("~safe_distance_m", 1.0, minimum=0.01, read_only=True))
        reports = await outlet(node, "actuation_report", ActuationReport, 100)
        self._navigation = NavigationClient(node, names, service, speed, reports.publish)

    def _link_changed(self, value: object) -> None:
        self._own.name = str(value)

    def _deadline_changed(self, value: object) -> None:
        self.core.deadline_ms = float(str(value)) or None

    async def _subscribe(self, node: NodeHandle) -> None:
        await self.listen(node, "phy_layer_metrics", PhyLayerMetrics, self._came)
        await node.subscribe("/task_status", String, self._task_status)
        await node.subscribe("/robot/pose", PoseStamped, self._pose)
        await node.subscribe("/robot/velocity", TwistStamped, self._velocity)
        await node.subscribe("/active_sensors", MarkerArray, self._sensors)
        await node.subscribe("/map", OccupancyGrid, self._map_came, qos=_LATCHED)
        await node.subscribe("/planned_path", Path, self._path_came)

    def link_count(self) -> int:
        """Links with a decision."""
        return self.core.link_count()

    def _came(self, message: PhyLayerMetrics) -> None:
        now_s = time.monotonic()
        self.newest[message.link_id] = message
        self._heard_s[message.link_id] = now_s
        self._own.heard(message.link_id, now_s)
        self.offer(message.link_id, message)

    def _forget_silent(self) -> None:
        now_s = time.monotonic()
        gone = [link for link, at_s in self._heard_s.items() if now_s - at_s > _FORGET_S]
        for link in gone:
            del self._heard_s[link]
            self.newest.pop(link, None)
            self.forget(link)
            self.core.forget(link)

    def _task_status(self, message: String) -> None:
        self.core.criticality.status(message.data)

    def _velocity(self, message: TwistStamped) -> None:
        speed = message.twist.linear
        self.robot.moves(speed.x, speed.y, speed.z, time.monotonic())

    def _sensors(self, message: MarkerArray) -> None:
        self.robot.sensors(message.markers, time.monotonic())

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
        is_own = item.link_id == self._own.link(time.monotonic())
        self.core.active_sensors = self.robot.sensor_count(time.monotonic()) if is_own else 0
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
        if is_own:
            self._tell(item, decision)
            self._tell_control(item)
            self._navigation.follow(item.link_id, limits)

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

    def _tell_control(self, item: PhyLayerMetrics) -> None:
        """What a control loop over the robot's own link should keep to."""
        if not self._limits.is_heard or not item.channel_response_time:
            return
        limits = convert_network_metrics_to_control_limits(
            item.channel_response_time, safe_distance_m=self._safe_m
        )
        speed = self.robot.speed_mps(time.monotonic())
        message = ControlLimits(
            link_id=item.link_id,
            max_speed_mps=limits.max_speed_mps,
            max_rate_hz=limits.max_rate_hz,
            hold_timeout_s=limits.hold_timeout_s,
            speed_mps=speed or 0.0,
            too_fast=speed is not None and speed > limits.max_speed_mps,
        )
        message.header.stamp.CopyFrom(item.header.stamp)
        self._limits.publish(message)

    # -- maps and ways ---------------------------------------------------------------------------

    def _map_came(self, message: OccupancyGrid) -> None:
        frame = frame_of(message)
        if frame is None:
            logger.warning("a map without cells or resolution came; it is not used")
            return
        if self.quality is None:
            self.quality = QualityMap(frame)
        elif self.quality.frame != frame:
            self.quality = self.quality.moved(frame)
        self.map = message

    def _pose(self, message: PoseStamped) -> None:
        now_s = time.monotonic()
        metrics, silent_s = self.newest.get(self._own.link(now_s)), self._own.silent_s(now_s)
        if metrics is None or silent_s is None or silent_s > _FRESH_S:
            # What was measured elsewhere, before the link fell silent, says nothing of this place.
            return
        if self.quality is not None:
            at = message.pose.position
            self.quality.update(at.x, at.y, metrics.link_quality, now_s)

    def _path_came(self, message: Path) -> None:
        self._planned = message
        if self._planning is None or self._planning.done():
            self._planning = asyncio.create_task(self._plan())

    async def _plan(self) -> None:
        """A better way for the newest plan; one at a time, and metrics do not wait for it."""
        while self._planned is not None:
            path, self._planned = self._planned, None
            response = await asyncio.to_thread(self._better_way, path, 0.0)
            if response.success:
                self._way.publish(response.path)
            if response.before.dead_zone_m:
                logger.warning("the planned path: %s", response.message)

    def _publish_enhanced(self) -> None:
        if self.map is not None and self._enhanced.subscriber_count:
            self._enhanced.publish(self._with_quality(self.map))

    def _with_quality(self, grid: OccupancyGrid) -> OccupancyGrid:
        frame = frame_of(grid)
        assert frame is not None
        quality = QualityMap(frame) if self.quality is None else self.quality
        if quality.frame != frame:
            quality = quality.moved(frame)
        cells = enhanced_cells(occupancy_grid_to_numpy(grid), quality.quality)
        return numpy_to_occupancy_grid(
            cells, grid.info.resolution, origin=grid.info.origin, header=grid.header
        )

    async def _optimize_path(self, request: OptimizePathRequest) -> OptimizePathResponse:
        path, problem = request.path, ""
        if len(path.poses) == 2:
            # Two ends are no path yet: the stack's own plan is what a better way is compared with.
            plan, problem = await self._navigation.plan(path.poses[0], path.poses[1])
            path = path if plan is None else plan
        # Planning takes a while on a large map; metrics must not wait for it.
        response = await asyncio.to_thread(self._better_way, path, request.weight)
        if problem:
            response.message = f"{response.message} ({problem})"
        return response

    def _better_way(self, path: Path, weight: float) -> OptimizePathResponse:
        wanted = weight or float(self._node.parameters["~comm_weight"])
        return better_way(path, self.map, self.quality, wanted)

    async def _enhance(
        self, goal: ServerGoal[EnhanceMapGoal, EnhanceMapResult, EnhanceMapFeedback]
    ) -> EnhanceMapResult:
        given = goal.goal.map
        grid = given if given.data else self.map
        if grid is None or frame_of(grid) is None:
            goal.abort(EnhanceMapResult(), "there is no map")
            return EnhanceMapResult()
        result = self._with_quality(grid)
        goal.publish_feedback(EnhanceMapFeedback(progress=1.0))
        known = 0 if self.quality is None else self.quality.known_cells()
        return EnhanceMapResult(map=result, known_cells=known)
