"""The cells on topics: camera, lidar, telemetry, command, with constraints, grants and degradation."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import numpy as np
import pytest
from support.cli import run_json
from support.waiting import until

from simple_ros.aio import NodeHandle, Publisher
from simple_ros.arguments import Arguments
from simple_ros.msg.geometry_msgs import PoseStamped, Twist
from simple_ros.msg.nav_msgs import Path
from simple_ros.msg.sensor_msgs import CompressedImage, Image, PointCloud2, PointField
from simple_ros.msg.wireless_ros_msgs import (
    CellStatus,
    ChannelState,
    Constraint,
    Degradation,
    EngineStatus,
    ResourceGrants,
)
from simple_ros.qos import LATCHED
from simple_ros_hub.cells.camera import CameraCell
from simple_ros_hub.cells.command import CommandCell
from simple_ros_hub.cells.lidar import LidarCell
from simple_ros_hub.cells.telemetry import TelemetryCell
from simple_ros_hub.cells.topic_cell import TopicCell
from simple_ros_master import Master


@asynccontextmanager
async def running(cell: TopicCell, master: Master, **parameters: Any) -> AsyncIterator[NodeHandle]:
    """A cell at work, with parameters set before it starts."""
    async with NodeHandle(cell.node_name, master=master.address, arguments=Arguments()) as node:
        await node.set_parameters({f"~{name}": value for name, value in parameters.items()})
        task = asyncio.create_task(cell.run(node))
        try:
            await until(lambda: cell.active or task.done(), "an active cell")
            yield node
        finally:
            task.cancel()
            (ended,) = await asyncio.gather(task, return_exceptions=True)
            if ended is not None and not isinstance(ended, asyncio.CancelledError):
                raise ended


class Robot:
    """The rest of the robot, and what the engines and the hub would say."""

    def __init__(self, node: NodeHandle) -> None:
        self.node = node

    async def open(self) -> None:
        advertise = self.node.advertise
        self.constraint = await advertise("/wireless_ros/constraints", Constraint)
        self.channel = await advertise("/wireless_ros/channel_state", ChannelState)
        self.level = await advertise("/wireless_ros/degradation", Degradation, qos=LATCHED)
        self.grants = await advertise("/wireless_ros/resource_grants", ResourceGrants, qos=LATCHED)

    async def heard(self, *publishers: Publisher[Any]) -> None:
        await until(lambda: all(item.subscriber_count for item in publishers), "subscribers")


@pytest.fixture
async def robot(master: Master) -> AsyncIterator[Robot]:
    async with NodeHandle("robot", master=master.address, arguments=Arguments()) as node:
        made = Robot(node)
        await made.open()
        yield made


def picture() -> Image:
    return Image(height=48, width=64, encoding="rgb8", step=192, data=bytes(range(192)) * 48)


async def test_the_camera_cell_follows_its_constraint(master: Master, robot: Robot) -> None:
    cell = CameraCell()
    seen: list[Image] = []
    beats: list[EngineStatus] = []
    statuses: list[CellStatus] = []
    raw = await robot.node.advertise("/camera/image_raw", Image)
    await robot.node.subscribe("/camera/cell/image_raw", Image, seen.append)
    await robot.node.subscribe("/wireless_ros/status", EngineStatus, beats.append)
    await robot.node.subscribe("/wireless_ros/cell_status", CellStatus, statuses.append)
    async with running(cell, master):
        await robot.heard(raw, robot.constraint, robot.grants, robot.level)
        await until(lambda: cell._publisher and cell._publisher.subscriber_count, "a viewer")
        raw.publish(picture())
        await until(lambda: len(seen) == 1, "a picture")
        assert seen[0] == picture()

        narrow = Constraint(
            link_id="4601",
            resolution_scale=50,
            frame_rate=1000,
            max_data_rate=10,
            constraint_type="REDUCED",
        )
        robot.constraint.publish(narrow)
        await until(lambda: cell.treatment.scale == 50, "the constraint")
        raw.publish(picture())
        await until(lambda: len(seen) == 2, "a smaller picture")
        assert (seen[1].width, seen[1].height) == (32, 24)
        assert cell.budget.bytes_per_s == pytest.approx(10e6 * 0.5 / 8)

        grants = ResourceGrants()
        grants.grants.add(link_id="4601", granted_bps=1e6)
        robot.grants.publish(grants)
        await until(lambda: cell.budget.bytes_per_s == pytest.approx(1e6 * 0.5 / 8), "the grant")

        robot.level.publish(Degradation(level=2, min_priority=4, rate_factor=0.5))
        await until(lambda: cell.budget.min_priority == 4, "the level")
        raw.publish(picture())
        await until(lambda: cell.held_back == 1, "a picture held back")
        assert len(seen) == 2

        raw.publish(Image(height=9, width=9, encoding="rgb8", step=3, data=b"short"))
        await until(lambda: statuses and statuses[-1].messages_in == 4, "the status")
        assert statuses[-1].constraint_type == "REDUCED"
        assert statuses[-1].memory_bytes > 1_000_000
        await until(lambda: beats and beats[-1].state == "active", "its state")
        assert beats[-1].kind == "cell"
        assert beats[-1].name == "wireless_ros/camera_cell"


async def test_pictures_as_jpeg_come_back_to_full_quality(master: Master, robot: Robot) -> None:
    cell = CameraCell()
    seen: list[CompressedImage] = []
    raw = await robot.node.advertise("/camera/image_raw", Image)
    await robot.node.subscribe("/camera/cell/image_raw/compressed", CompressedImage, seen.append)
    noise = np.random.default_rng(1).integers(0, 255, 480 * 640 * 3, np.uint8)
    image = Image(height=480, width=640, encoding="rgb8", step=1920, data=noise.tobytes())

    def sizes(wanted: Callable[[int], bool]) -> Callable[[], bool]:
        """Publish until a picture of a wanted size comes."""

        def came() -> bool:
            if not cell._busy:
                raw.publish(image)
            return bool(seen) and wanted(len(seen[-1].data))

        return came

    async with running(cell, master, image_format="jpeg", dwell=0.1):
        await robot.heard(raw, robot.constraint)
        await until(lambda: cell._publisher and cell._publisher.subscriber_count, "a viewer")
        await until(sizes(lambda size: size > 0), "a picture")
        full = len(seen[0].data)
        robot.constraint.publish(Constraint(resolution_scale=50, frame_rate=20, max_data_rate=50))
        await until(sizes(lambda size: size < 0.5 * full), "a smaller picture")
        assert cell.treatment.scale == 50

        def healthy() -> bool:
            robot.constraint.publish(Constraint(resolution_scale=100, max_data_rate=5000))
            return cell.treatment.is_untouched

        await until(healthy, "a healthy link")
        await until(sizes(lambda size: size > 0.9 * full), "a full picture")


async def test_the_budget_delays_and_then_drops(master: Master, robot: Robot) -> None:
    cell = CameraCell()
    seen: list[Image] = []
    raw = await robot.node.advertise("/camera/image_raw", Image)
    await robot.node.subscribe("/camera/cell/image_raw", Image, seen.append)
    async with running(cell, master, deadline=0.2):
        await robot.heard(raw, robot.constraint)
        await until(lambda: cell._publisher and cell._publisher.subscriber_count, "a viewer")
        # 20 kB/s for the camera, of which a picture takes 9.2 kB.
        robot.constraint.publish(Constraint(resolution_scale=100, max_data_rate=0.32))
        await until(lambda: cell.budget.bytes_per_s == pytest.approx(20_000, rel=0.01), "a budget")
        for _ in range(20):
            raw.publish(picture())
        await until(lambda: cell.held_back + cell.messages_out == 20, "all settled")
        assert 1 <= cell.messages_out <= 6
        await until(lambda: len(seen) == cell.messages_out, "what was sent")


async def test_the_lidar_cell_thins_out(master: Master, robot: Robot) -> None:
    cell = LidarCell()
    seen: list[PointCloud2] = []
    points = np.random.default_rng(1).uniform(0, 1, (2000, 3)).astype("<f4")
    cloud = PointCloud2(
        height=1,
        width=2000,
        fields=[
            PointField(name=axis, offset=4 * index, datatype=PointField.FLOAT32, count=1)
            for index, axis in enumerate("xyz")
        ],
        point_step=12,
        row_step=24000,
        data=points.tobytes(),
    )
    raw = await robot.node.advertise("/lidar/points", PointCloud2)
    await robot.node.subscribe("/lidar/cell/points", PointCloud2, seen.append)
    async with running(cell, master, point_spacing=0.1):
        await robot.heard(raw, robot.constraint)
        await until(lambda: cell._publisher and cell._publisher.subscriber_count, "a viewer")
        raw.publish(cloud)
        await until(lambda: len(seen) == 1, "a cloud")
        assert seen[0] == cloud
        robot.constraint.publish(Constraint(resolution_scale=30, frame_rate=1000))
        await until(lambda: cell.treatment.scale == 30, "the constraint")
        raw.publish(cloud)
        await until(lambda: len(seen) == 2, "a thinner cloud")
        assert 0 < seen[1].width < 500


async def test_the_telemetry_cell_keeps_the_track_in_a_dead_zone(
    master: Master, robot: Robot
) -> None:
    cell = TelemetryCell()
    seen: list[Path] = []
    poses = await robot.node.advertise("/robot/pose", PoseStamped)
    await robot.node.subscribe("/telemetry/track", Path, seen.append)

    def drive(begin: int, count: int) -> None:
        for x in range(begin, begin + count):
            pose = PoseStamped()
            pose.pose.position.x = x
            poses.publish(pose)

    def driven() -> list[float]:
        return [pose.pose.position.x for path in seen for pose in path.poses]

    async with running(cell, master, period=0.05):
        await robot.heard(poses, robot.constraint, robot.level)
        await until(lambda: cell.has_link, "a listener")
        drive(0, 10)
        await until(lambda: len(driven()) == 10, "the first part")
        robot.constraint.publish(Constraint(max_data_rate=0, link_id="4601"))
        await until(lambda: not cell.has_link, "a dead zone")
        drive(10, 50)
        await until(lambda: len(cell.track) == 50, "poses kept")
        assert len(driven()) == 10
        robot.constraint.publish(Constraint(max_data_rate=5, link_id="4601"))
        await until(lambda: len(driven()) == 60, "the rest")
        assert driven() == list(range(60))


async def test_the_command_cell_limits_and_holds(master: Master, robot: Robot) -> None:
    cell = CommandCell()
    driven: list[Twist] = []
    remote = await robot.node.advertise("/cmd_vel/remote", Twist)
    await robot.node.subscribe("/cmd_vel", Twist, driven.append)

    def command(speed: float) -> None:
        message = Twist()
        message.linear.x = speed
        remote.publish(message)

    async with running(cell, master):
        await robot.heard(remote, robot.channel, robot.level)
        await until(lambda: cell._publisher and cell._publisher.subscriber_count, "a robot")
        command(0.5)
        await until(lambda: [m.linear.x for m in driven][:1] == [0.5], "a command")
        await until(lambda: [m.linear.x for m in driven] == [0.5, 0.0], "a hold after silence")
        assert cell.guard.holds == 1
        robot.channel.publish(ChannelState(link_id="4601", rtt_ms=800))
        await until(lambda: cell.guard.limits.max_speed_mps == pytest.approx(0.8), "slower")
        command(3.0)
        await until(lambda: len(driven) >= 3, "a limited command")
        assert driven[2].linear.x == pytest.approx(0.8)
        robot.level.publish(Degradation(level=3, min_priority=5, rate_factor=0.25, name="SAFE"))
        # It holds after silence, too.
        await until(lambda: cell.budget.min_priority == 5, "the level")
        await until(lambda: driven[-1].linear.x == 0, "a hold at level SAFE")
        count = len(driven)
        command(1.0)
        await until(lambda: cell.held_back == 1, "a command held back")
        assert len(driven) == count


async def test_cell_list() -> None:
    cells = await run_json("cell", "list")
    assert [cell["name"] for cell in cells] == [
        "camera",
        "command",
        "courier",
        "lidar",
        "telemetry",
    ]
