"""Turtlesim and its controllers as nodes: the loop over topics, services, page, markers, adaptation."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from support.browser import BROWSER
from support.devtools import opened
from support.engines import at_work, user
from support.waiting import until

from simple_ros.errors import RemoteServiceError
from simple_ros.msg.geometry_msgs import Twist
from simple_ros.msg.std_srvs import Empty, EmptyRequest
from simple_ros.msg.turtlesim_msgs import (
    AdaptationRequest,
    ControlStatus,
    Kill,
    KillRequest,
    Mos,
    Pose,
    SetPen,
    SetPenRequest,
    Spawn,
    SpawnRequest,
    TeleportAbsolute,
    TeleportAbsoluteRequest,
    TeleportRelative,
    TeleportRelativeRequest,
)
from simple_ros.msg.visualization_msgs import MarkerArray
from simple_ros.qos import SENSOR_DATA
from simple_ros_engines.network_exposure.turtlesim.controller_node import TurtleController
from simple_ros_engines.network_exposure.turtlesim.node import Turtlesim
from simple_ros_master import Master

PLAIN = {"tag": "", "page": "127.0.0.1:0"}


async def test_poses_have_a_tag_and_commands_none(master: Master) -> None:
    poses: list[Pose] = []
    engine = Turtlesim()
    async with user(master) as node, at_work(engine, master, page="0"):
        await node.subscribe("turtle1/pose_qos", Pose, poses.append, qos=SENSOR_DATA)
        drive = await node.advertise("turtle1/cmd_vel", Twist)
        command = Twist()
        command.linear.x, command.angular.z = 1.0, 0.5
        node.create_timer(0.05, lambda _: drive.publish(command))
        await until(lambda: poses and poses[-1].x > 6 and poses[-1].theta > 0.1, "it drives")
        await until(lambda: poses[-1].linear_velocity == pytest.approx(1.0), "at that speed")
        command.linear.x = math.nan
        seen = len(poses)
        await until(lambda: len(poses) > seen + 5)
        assert math.isfinite(poses[-1].x)


async def test_turtles_come_and_go(master: Master) -> None:
    engine = Turtlesim()
    async with user(master) as node, at_work(engine, master, **PLAIN):
        spawn = node.service_client("spawn", Spawn)
        await spawn.wait_for_service(30)
        assert (await spawn.call(SpawnRequest(x=1, y=2, theta=0.5))).name == "turtle2"
        assert (await spawn.call(SpawnRequest(x=1, y=2, name="bob"))).name == "bob"
        refused = await spawn.call(SpawnRequest(x=1, y=2, name="bob"))
        assert refused.name == ""
        assert "there already" in refused.message
        assert "0 to 11.089" in (await spawn.call(SpawnRequest(x=-1, y=2))).message
        poses: list[Pose] = []
        await node.subscribe("bob/pose", Pose, poses.append, qos=SENSOR_DATA)
        await until(lambda: poses)
        pen = node.service_client("bob/set_pen", SetPen)
        await pen.call(SetPenRequest(r=255, g=1, b=999, width=0))
        assert engine.world.turtles["bob"].pen.b == 255
        jump = node.service_client("bob/teleport_absolute", TeleportAbsolute)
        await jump.call(TeleportAbsoluteRequest(x=3, y=4, theta=0))
        push = node.service_client("bob/teleport_relative", TeleportRelative)
        await push.call(TeleportRelativeRequest(linear=1, angular=math.pi / 2))
        assert engine.world.turtles["bob"].y == pytest.approx(5)
        with pytest.raises(RemoteServiceError, match="cannot be at"):
            await jump.call(TeleportAbsoluteRequest(x=30, y=4))
        kill = node.service_client("kill", Kill)
        assert (await kill.call(KillRequest(name="bob"))).success
        assert "not there" in (await kill.call(KillRequest(name="bob"))).message
        count = len(poses)
        again = await spawn.call(SpawnRequest(x=1, y=2, name="bob"))
        assert again.name == "bob"
        await until(lambda: len(poses) > count, "poses of the new one")
        await node.service_client("reset", Empty).call(EmptyRequest())
        assert list(engine.world.turtles) == ["turtle1"]
        assert not list(engine.world.strokes(0))


async def test_the_loop_closes_over_topics_and_does_what_it_is_asked(master: Master) -> None:
    statuses: list[ControlStatus] = []
    scores: list[Mos] = []
    sim, controller = Turtlesim(), TurtleController()
    async with (
        user(master) as node,
        at_work(sim, master, **PLAIN),
        at_work(controller, master, tag="", radius=1.0, tolerance=0.3),
    ):
        await node.subscribe("turtle1/control_status", ControlStatus, statuses.append)
        await node.subscribe("/MOS", Mos, scores.append)
        asking = await node.advertise("/application_adaptation_request", AdaptationRequest)
        jump = node.service_client("turtle1/teleport_absolute", TeleportAbsolute)
        await jump.wait_for_service(30)
        await jump.call(TeleportAbsoluteRequest(x=6.544, y=5.544, theta=math.pi / 2))
        await until(lambda: statuses and statuses[-1].progress > 0.7, "progress", 60)
        await until(lambda: scores, "a score of its own")
        assert scores[-1].identifier == Mos.AUTOMATIC
        assert list(scores[-1].topics) == ["turtle1/pose", "turtle1/cmd_vel"]
        await asking.wait_for_subscribers(2, timeout=30)
        asking.publish(AdaptationRequest(group="turtle2", speed_factor=0.1))
        asking.publish(
            AdaptationRequest(topics=["/turtle1/pose"], speed_factor=0.5, rate_factor=0.25)
        )
        await until(lambda: statuses[-1].speed_factor == 0.5)
        assert statuses[-1].control_rate == pytest.approx(5.0)
        assert statuses[-1].wanted_speed == 1.0
        # Slower than it was made for, so it judges itself worse, however exact it is.
        await until(lambda: statuses[-1].progress < 0.65, "slower", 20)
        assert statuses[-1].mos < 3.7


async def test_without_a_turtle_the_controller_does_not_praise_itself(master: Master) -> None:
    statuses: list[ControlStatus] = []
    controller = TurtleController()
    async with user(master) as node, at_work(controller, master, tag=""):
        await node.subscribe("turtle1/control_status", ControlStatus, statuses.append)
        async with at_work(Turtlesim(), master, **PLAIN):
            await until(lambda: statuses and statuses[-1].mos > 0, "a score", 20)
        await until(lambda: statuses[-1].pose_age > 1.0, "silence", 20)
        await until(lambda: statuses[-1].mos == 1.0, "the worst score")


async def test_markers_for_foxglove(master: Master) -> None:
    arrays: list[MarkerArray] = []
    async with user(master) as node, at_work(Turtlesim(), master, turtles=2, **PLAIN):
        await node.subscribe("turtlesim/markers", MarkerArray, arrays.append)
        await until(lambda: arrays)
    assert {marker.ns for marker in arrays[-1].markers} >= {"ground", "turtle1", "turtle2"}


@pytest.mark.skipif(BROWSER is None, reason="needs chromium")
async def test_turtles_and_lines_are_seen_in_a_browser(master: Master, tmp_path: Path) -> None:
    engine = Turtlesim()
    async with user(master) as node, at_work(engine, master, turtles=2, **PLAIN):
        await until(lambda: engine.url and len(engine.world.turtles) == 2)
        jump = node.service_client("turtle1/teleport_absolute", TeleportAbsolute)
        pen = node.service_client("turtle1/set_pen", SetPen)
        await pen.wait_for_service(30)
        await pen.call(SetPenRequest(r=255, width=10))
        await jump.call(TeleportAbsoluteRequest(x=2.0, y=5.544))
        async with opened(engine.url, tmp_path) as page:
            await page.becomes("document.getElementById('turtles').rows.length === 3")

            def pixel(x: float, y: float) -> str:
                at = f"{round(x * 45)}, {round(500 - y * 45)}"
                return f"[...canvas.getContext('2d').getImageData({at}, 1, 1).data].join()"

            await page.becomes(f"{pixel(4.0, 5.544)} === '255,0,0,255'", "the red line")
            await page.becomes(f"{pixel(4.0, 1.0)} === '69,86,255,255'", "the background")
            await node.service_client("clear", Empty).call(EmptyRequest())
            await page.becomes(f"{pixel(4.0, 5.544)} === '69,86,255,255'", "no line")
