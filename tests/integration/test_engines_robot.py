"""The cross-domain engine as part of a robot: its speed, its sensors, its navigation stack."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import numpy as np
import pytest
from support.waiting import until

from simple_ros.arguments import Arguments
from simple_ros.errors import ConfigError
from simple_ros.msg.arrays import numpy_to_occupancy_grid
from simple_ros.msg.geometry_msgs import PoseStamped, TwistStamped
from simple_ros.msg.nav_msgs import GetPlan, GetPlanRequest, GetPlanResponse, OccupancyGrid, Path
from simple_ros.msg.std_msgs import String
from simple_ros.msg.visualization_msgs import DELETE, DELETEALL, Marker, MarkerArray
from simple_ros.msg.wireless_ros_msgs import (
    ActuationReport,
    ControlLimits,
    OptimizePath,
    OptimizePathRequest,
    PhyLayerMetrics,
)
from simple_ros.node import NodeHandle
from simple_ros.qos import LATCHED
from simple_ros_engines.cross_domain.navigation import nav_parameter_names
from simple_ros_engines.cross_domain.node import CrossDomainEngine
from simple_ros_engines.cross_domain.robot_state import RobotState
from simple_ros_engines.mapping_parameter import object_of
from simple_ros_master import Master


def handle(name: str, master: Master) -> NodeHandle:
    return NodeHandle(name, master=master.address, arguments=Arguments())


@asynccontextmanager
async def engine(master: Master, **parameters: Any) -> AsyncIterator[CrossDomainEngine]:
    made = CrossDomainEngine()
    async with handle(made.node_name, master) as node:
        await node.set_parameters({f"~{name}": value for name, value in parameters.items()})
        task = asyncio.create_task(made.run(node))
        try:
            yield made
        finally:
            task.cancel()
            (ended,) = await asyncio.gather(task, return_exceptions=True)
            if ended is not None and not isinstance(ended, asyncio.CancelledError):
                raise ended


async def metrics(node: NodeHandle) -> Callable[..., Any]:
    """Publishes metrics of the robot's link until something holds."""
    publisher = await node.advertise("/wireless_ros/phy_layer_metrics", PhyLayerMetrics)
    await publisher.wait_for_subscribers(1, timeout=30)

    async def until_so(condition: Callable[[], object], **values: Any) -> None:
        number = 0
        while not condition():
            number += 1
            values = {"link_quality": 0.7, "reliability": 0.9, "available_bps": 12e6} | values
            message = PhyLayerMetrics(link_id="4601", **values)
            message.header.stamp.FromNanoseconds(number)
            publisher.publish(message)
            with contextlib.suppress(AssertionError):
                await until(condition, limit=0.1)

    return until_so


async def test_the_speed_of_the_robot_is_held_against_the_round_trip(master: Master) -> None:
    found: list[ControlLimits] = []
    async with handle("user", master) as user, engine(master):
        await user.subscribe("/wireless_ros/control_limits", ControlLimits, found.append)
        velocity = await user.advertise("/robot/velocity", TwistStamped)
        await velocity.wait_for_subscribers(1, timeout=30)
        until_so = await metrics(user)
        await until_so(lambda: found, channel_response_time=200.0)
        assert found[0].max_speed_mps == pytest.approx(2.0)
        assert (found[0].speed_mps, found[0].too_fast) == (0, False)
        twist = TwistStamped()
        twist.twist.linear.x = 3.0
        velocity.publish(twist)
        await until_so(lambda: found[-1].too_fast, channel_response_time=200.0)
        assert found[-1].speed_mps == 3.0


async def test_sensors_that_are_at_work_share_the_link(master: Master) -> None:
    modes: list[String] = []
    async with handle("user", master) as user, engine(master) as made:
        await user.subscribe("/wireless_ros/sensor_mode", String, modes.append)
        sensors = await user.advertise("/active_sensors", MarkerArray)
        await sensors.wait_for_subscribers(1, timeout=30)
        until_so = await metrics(user)
        await until_so(lambda: modes)
        assert modes[-1].data == "HIGH_RESOLUTION"
        markers = [Marker(ns=name, id=1) for name in ("camera", "lidar")]
        sensors.publish(MarkerArray(markers=markers))
        await until_so(lambda: made.core.active_sensors == 2)
        await until_so(lambda: modes[-1].data == "STANDARD")


def test_sensors_come_go_and_run_out() -> None:
    robot = RobotState()
    assert robot.sensor_count(0) == 0
    robot.sensors([Marker(ns="a"), Marker(ns="b", lifetime=5.0), Marker(ns="c")], 10.0)
    assert robot.sensor_count(14.9) == 3
    assert robot.sensor_count(15.1) == 2
    robot.sensors([Marker(ns="a", action=DELETE), Marker(ns="x", action=DELETE)], 16.0)
    assert robot.sensor_count(16) == 1
    robot.sensors([Marker(action=DELETEALL)], 17.0)
    assert robot.sensor_count(17) == 0


def test_a_speed_is_only_known_while_it_is_told() -> None:
    robot = RobotState()
    assert robot.speed_mps(0.0) is None
    robot.moves(3.0, 4.0, 0.0, 10.0)
    robot.moves(math.nan, 0.0, 0.0, 10.5)
    assert robot.speed_mps(11.0) == 5.0
    assert robot.speed_mps(12.1) is None


NAMES = {"max_vel_mps": "/nav/max_vel_x", "inflation_radius_m": "/nav/inflation"}


async def test_the_navigation_stacks_parameters_follow_the_link(master: Master) -> None:
    reports: list[ActuationReport] = []
    async with handle("nav", master) as nav, handle("user", master) as user:
        await nav.declare_parameter("/nav/max_vel_x", 1.5, minimum=0.1, maximum=2.0)
        await nav.declare_parameter("/nav/inflation", 0.3, maximum=0.5)
        await user.subscribe("/wireless_ros/actuation_report", ActuationReport, reports.append)
        async with engine(master, navigation_parameters=json.dumps(NAMES)):
            until_so = await metrics(user)
            await until_so(lambda: reports, channel_response_time=20.0)
            await until(lambda: nav.parameters["/nav/max_vel_x"] < 1.5)
            fast = float(nav.parameters["/nav/max_vel_x"])
            await until_so(
                lambda: float(nav.parameters["/nav/max_vel_x"]) < 0.8 * fast,
                channel_response_time=200.0,
            )
            assert reports[0].actuator == "navigation"
            assert all(item.applied for item in reports)
            # 10 s late, and the stack does not go as slow as that.
            await until_so(lambda: not reports[-1].applied, channel_response_time=10_000.0)
            assert "OutOfRange" in reports[-1].detail


def test_wrong_parameter_names_are_refused() -> None:
    assert nav_parameter_names(object_of("")) == {}
    for text, words in (("[]", "no JSON object"), ("{", "no JSON"), ('{"x": "y"}', "none of")):
        with pytest.raises(ConfigError, match=words):
            nav_parameter_names(object_of(text))


def poses(*points: tuple[float, float]) -> Path:
    path = Path()
    for x, y in points:
        pose = PoseStamped()
        pose.pose.position.x, pose.pose.position.y = x, y
        path.poses.append(pose)
    return path


async def test_between_two_ends_the_stacks_own_plan_is_compared(master: Master) -> None:
    asked: list[GetPlanRequest] = []

    async def plan(request: GetPlanRequest) -> GetPlanResponse:
        asked.append(request)
        return GetPlanResponse(plan=poses((1, 1), (1, 4), (4, 4)))

    async with handle("nav", master) as nav, handle("user", master) as user:
        maps = await user.advertise("/map", OccupancyGrid, qos=LATCHED)
        maps.publish(numpy_to_occupancy_grid(np.zeros((50, 50), np.int8), 0.1))
        async with engine(master, plan_service="/nav/make_plan") as made:
            await until(lambda: made.quality is not None)
            client = user.service_client("/wireless_ros/optimize_path", OptimizePath, timeout=30)
            await client.wait_for_service(30)
            request = OptimizePathRequest(path=poses((1, 1), (4, 4)))
            alone = await client.call(request)
            assert alone.success
            assert "gave no plan" in alone.message
            assert alone.before.length_m == pytest.approx(4.24, abs=0.1)
            await nav.advertise_service("/nav/make_plan", GetPlan, plan)
            answer = await client.call(request)
            assert asked[0].goal.pose.position.x == 4
            assert answer.before.length_m == pytest.approx(6.0, abs=0.1)
            assert answer.after.length_m < 4.6
