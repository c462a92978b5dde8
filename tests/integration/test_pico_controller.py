"""The whole robot: simulated board, bridge, controller; and what happens when the board dies."""

from __future__ import annotations

import logging
import math
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from support.processes import python
from support.waiting import until

from simple_ros import aio
from simple_ros.msg.geometry_msgs import Twist
from simple_ros.msg.nav_msgs import Odometry
from simple_ros.msg.std_msgs import String
from simple_ros.tf import TransformListener
from simple_ros_firmware_bridge import control
from simple_ros_firmware_bridge.bridge import PicoBridge
from simple_ros_firmware_bridge.config import BoardConfig
from simple_ros_firmware_bridge.control import manager as manager_module
from simple_ros_firmware_bridge.control.lifecycle import State
from simple_ros_firmware_bridge.control.manager import ControllerManager
from simple_ros_firmware_bridge.control.settings import declared_settings
from simple_ros_firmware_bridge.simulator.firmware import Firmware
from simple_ros_firmware_bridge.simulator.pty_board import PtyBoard
from simple_ros_master import Master


@asynccontextmanager
async def controller(master: Master, **options: Any) -> AsyncIterator[ControllerManager]:
    async with aio.NodeHandle("controller_manager", master=master.address) as node:
        # Tests share two cores with others: dead is what was silent for longer than any of them stands still.
        await node.set_parameters({"~joint_period_s": 0.25, "~imu_period_s": 0.25})
        made = await ControllerManager.create(node, await declared_settings(node), **options)
        try:
            yield made
        finally:
            await made.close()


@asynccontextmanager
async def bridge(master: Master, port: str) -> AsyncIterator[None]:
    config = BoardConfig(port, remap={"cmd_vel": "hardware/cmd_vel"})
    async with aio.NodeHandle("pico_bridge", master=master.address) as node:
        async with PicoBridge(node, [config]):
            yield


async def test_the_robot_drives_and_knows_where_it_is(master: Master) -> None:
    firmware = Firmware()
    async with (
        PtyBoard(firmware) as board,
        bridge(master, board.path),
        controller(master) as manager,
        aio.NodeHandle("pilot", master=master.address) as pilot,
    ):
        odometry: list[Odometry] = []
        await pilot.subscribe("odometry/wheels", Odometry, odometry.append)
        listener = await TransformListener.create(pilot)
        commands = await pilot.advertise("cmd_vel", Twist)
        await until(lambda: manager.lifecycles["RobotSystem"].state is State.ACTIVE, "activation")
        wish = Twist()
        wish.linear.x, wish.angular.z = 0.4, 0.8
        pilot.create_timer(0.05, lambda _: commands.publish(wish))
        await until(lambda: firmware.robot.pose.yaw > 0.5, "movement")
        wish.Clear()
        await until(lambda: abs(firmware.robot.body.vx) < 1e-3, "standing")

        def is_right() -> bool:
            truth, told = firmware.robot.pose, odometry[-1].pose.pose.position
            seen = listener.buffer.lookup_transform("odom", "base_link").transform.translation
            is_near = math.hypot(told.x - truth.x, told.y - truth.y) < 0.01
            return is_near and seen.x == pytest.approx(truth.x, abs=0.02)

        await until(lambda: odometry and listener.buffer.can_transform("odom", "base_link"))
        await until(is_right, "right odometry and transform")
        assert len(odometry[-1].pose.covariance) == 36
        for state in manager.lifecycles.values():
            await until(lambda state=state: state.state is State.ACTIVE, state.name)  # type: ignore[misc]


async def test_a_dead_board_is_noticed_and_its_return_too(
    master: Master, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    link = tmp_path / "pico"
    caplog.set_level(logging.INFO)
    async with bridge(master, str(link)), controller(master) as manager:
        events: list[str] = []
        async with aio.NodeHandle("looker", master=master.address) as looker:
            await looker.subscribe(
                "RobotSystem/transition_event", String, lambda message: events.append(message.data)
            )
            system = manager.lifecycles["RobotSystem"]
            for _ in range(2):
                async with PtyBoard(Firmware(), link):
                    await until(lambda: system.state is State.ACTIVE, "activation")
                await until(lambda: system.state is not State.ACTIVE, "that it is dead")
                assert "the last joint states came" in caplog.text
            await until(lambda: any("error" in text for text in events), "its event")
            assert manager.lifecycles["drive_controller"].state is State.UNCONFIGURED


async def test_activation_waits_no_longer_than_it_may(
    master: Master, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(manager_module, "ACTIVATION_LIMIT_S", 0.1)
    async with controller(master) as manager:
        await until(lambda: "not activated within 0.1 s" in caplog.text, "the error")
        assert manager.lifecycles["RobotSystem"].state is not State.ACTIVE
    assert manager.lifecycles["RobotSystem"].state is State.FINALIZED


async def test_mock_mode_is_loud(master: Master, caplog: pytest.LogCaptureFixture) -> None:
    async with controller(master, is_mock=True) as manager:
        await until(lambda: "MOCK MODE" in caplog.text, "the warning")
        await until(lambda: manager.lifecycles["RobotSystem"].state is State.ACTIVE, "activation")


async def test_the_launch_file_starts_the_whole_robot(master: Master, tmp_path: Path) -> None:
    assert control.__file__ is not None
    launch = Path(control.__file__).parent.parent / "launch" / "robot_xl.yaml"
    words = ("launch", str(launch), "simulated:=true", f"link:={tmp_path / 'pico'}", "--plain")
    async with aio.NodeHandle("looker", master=master.address) as looker:
        odometry: list[Odometry] = []
        await looker.subscribe("odometry/wheels", Odometry, odometry.append)
        environment = {"SIMPLE_ROS_MASTER": master.address, "XDG_STATE_HOME": str(tmp_path)}
        async with python("-m", "simple_ros.cli.main", *words, **environment):
            await until(lambda: odometry, "odometry", 60)
            assert "ddd" not in master.graph.to_readable_string()
