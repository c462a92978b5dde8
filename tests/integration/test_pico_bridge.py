"""The bridge and a simulated board on a pseudo terminal."""

from __future__ import annotations

import asyncio
import logging
import os
import random
import signal
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from support.processes import python
from support.waiting import until

from simple_ros import aio
from simple_ros.msg.diagnostic_msgs import DiagnosticArray
from simple_ros.msg.geometry_msgs import Twist
from simple_ros.msg.nav_msgs import Odometry
from simple_ros.msg.registry import MsgFactory
from simple_ros.msg.sensor_msgs import Imu, JointState, Range
from simple_ros.msg.std_msgs import String
from simple_ros_firmware_bridge.bridge import PicoBridge
from simple_ros_firmware_bridge.config import BoardConfig
from simple_ros_firmware_bridge.simulator import client as client_module
from simple_ros_firmware_bridge.simulator.client import Stage
from simple_ros_firmware_bridge.simulator.creation import Topic
from simple_ros_firmware_bridge.simulator.firmware import Firmware
from simple_ros_firmware_bridge.simulator.pty_board import PtyBoard
from simple_ros_master import Master

STANDARD = {
    "joint_states": "sensor_msgs.JointState",
    "imu/data_raw": "sensor_msgs.Imu",
    "odom": "nav_msgs.Odometry",
    "sensors/range_tof": "sensor_msgs.Range",
    "sensors/range_ultrasonic": "sensor_msgs.Range",
    "sensors/illuminance": "sensor_msgs.Illuminance",
}


@asynccontextmanager
async def bridged(
    master: Master, board: PtyBoard, state: Path | None = None, **options: Any
) -> AsyncIterator[tuple[PicoBridge, aio.NodeHandle]]:
    """A bridge on the port of a board, and a node to look on."""
    address = master.address
    async with aio.NodeHandle("pico_bridge", master=address) as node:
        async with PicoBridge(node, [BoardConfig(board.path, **options)], state) as bridge:
            async with aio.NodeHandle("looker", master=address) as looker:
                yield bridge, looker


async def collect(node: aio.NodeHandle, topic: str, message_class: type[Any]) -> list[Any]:
    found: list[Any] = []
    await node.subscribe(topic, message_class, found.append)
    return found


@pytest.mark.parametrize("old_names", [False, True])
async def test_every_topic_has_its_standard_name_and_real_data(
    master: Master, old_names: bool
) -> None:
    firmware = Firmware(old_names=old_names, has_variance=old_names)
    async with PtyBoard(firmware) as board, bridged(master, board) as (_, looker):
        found = {
            topic: await collect(looker, topic, MsgFactory.instance().get_class(type_name))
            for topic, type_name in STANDARD.items()
        }
        await until(lambda: all(found.values()), "a message on every topic")
        assert "ddd" not in master.graph.to_readable_string()
        joints: JointState = found["joint_states"][-1]
        assert joints.name[0] == "front_left_wheel_joint"
        assert len(joints.velocity) == 4
        imu: Imu = found["imu/data_raw"][-1]
        assert imu.linear_acceleration.z == pytest.approx(9.8, abs=0.2)
        assert len(imu.orientation_covariance) == 9
        assert found["odom"][-1].child_frame_id == "base_link"
        near: Range = found["sensors/range_tof"][-1]
        assert (near.radiation_type, near.range) == (Range.INFRARED, pytest.approx(0.255))
        assert found["sensors/range_ultrasonic"][-1].range == pytest.approx(2.0)
        await until(lambda: found["sensors/illuminance"][-1].illuminance > 200, "light")


async def test_cmd_vel_drives_it(master: Master) -> None:
    firmware = Firmware()
    async with PtyBoard(firmware) as board, bridged(master, board) as (_, looker):
        odometry: list[Odometry] = await collect(looker, "odom", Odometry)
        commands = await looker.advertise("cmd_vel", Twist)
        await commands.wait_for_subscribers(timeout=30)
        drive = Twist()
        drive.linear.x = 0.5
        looker.create_timer(0.05, lambda _: commands.publish(drive))

        def is_driving() -> bool:
            # Both at a time: a board that hears nothing for half a second stops.
            last = odometry[-1] if odometry else Odometry()
            speed = last.twist.twist.linear.x
            return last.pose.pose.position.x > 0.1 and speed == pytest.approx(0.5, abs=0.2)

        await until(is_driving, "movement at that speed")


async def test_the_bridge_may_start_before_the_board_and_the_board_may_be_unplugged(
    master: Master, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    link = tmp_path / "pico"
    caplog.set_level(logging.INFO)
    async with aio.NodeHandle("pico_bridge", master=master.address) as node:
        async with PicoBridge(node, [BoardConfig(str(link))]):
            await until(lambda: "no such port" in caplog.text, "that there is no port")
            for _ in range(2):
                firmware = Firmware()
                async with PtyBoard(firmware, link) as board:
                    await until(lambda it=firmware: it.client.counters.published > 10, "samples")
                    board.say("hello from the board\r\n")
                    await until(lambda: "says: hello from the board" in caplog.text, "its text")
                caplog.clear()
                await until(lambda: "unplugged" in caplog.text, "that it is gone")


async def test_boards_with_prefixes_and_other_names(master: Master) -> None:
    left, right = Firmware(key=b"left"), Firmware(key=b"rght")
    async with PtyBoard(left) as one, PtyBoard(right) as two:
        configs = [
            BoardConfig(one.path, prefix="left", remap={"cmd_vel": "hardware/cmd_vel"}),
            BoardConfig(two.path, prefix="right"),
        ]
        async with aio.NodeHandle("pico_bridge", master=master.address) as node:
            async with PicoBridge(node, configs):
                names: Callable[[], str] = master.graph.to_readable_string
                for topic in ("left/odom", "right/odom", "left/hardware/cmd_vel", "right/cmd_vel"):
                    await until(lambda topic=topic: topic in names(), topic)  # type: ignore[misc]


def flipped(rng: random.Random) -> Callable[[bytes], bytes]:
    """One of a hundred chunks of 42 bytes with a flipped bit."""

    def spoil(data: bytes) -> bytes:
        out = bytearray(data)
        for start in range(0, len(out), 42):
            if rng.random() < 0.01:
                at = rng.randrange(start, min(start + 42, len(out)))
                out[at] ^= 1 << rng.randrange(8)
        return bytes(out)

    return spoil


async def test_a_bad_cable_costs_no_publish(master: Master) -> None:
    firmware = Firmware()
    spoil = flipped(random.Random(5))
    async with PtyBoard(firmware, spoil_up=spoil, spoil_down=spoil) as board:
        async with bridged(master, board) as (bridge, looker):
            joints = await collect(looker, "joint_states", JointState)
            commands = await looker.advertise("cmd_vel", Twist)
            looker.create_timer(0.05, lambda _: commands.publish(Twist()))
            await until(lambda: len(joints) > 300, "samples")
            assert bridge.boards[0].serial.reader.counters.damaged > 0
            assert firmware.client.counters.failed == 0


async def test_what_is_too_large_for_the_board_is_told(
    master: Master, caplog: pytest.LogCaptureFixture
) -> None:
    firmware = Firmware()
    firmware.client.topics.append(Topic(14, "/names", "std_msgs/String", is_published=False))
    async with PtyBoard(firmware) as board, bridged(master, board) as (_, looker):
        names = await looker.advertise("names", String)
        await names.wait_for_subscribers(timeout=30)
        names.publish(String(data="x" * 3000))
        await until(lambda: "takes 1992 at most" in caplog.text, "the refusal")
        assert "'names'" in caplog.text
        assert "3005 bytes" in caplog.text


async def test_diagnostics_say_how_it_is(master: Master) -> None:
    async with PtyBoard(Firmware()) as board, bridged(master, board) as (_, looker):
        reports: list[DiagnosticArray] = await collect(looker, "diagnostics", DiagnosticArray)

        def connected() -> bool:
            if not reports:
                return False
            (status,) = reports[-1].status
            values = {item.key: item.value for item in status.values}
            return status.message == "connected" and float(values.get("odom (Hz)", 0)) > 0

        await until(connected, "a good report")


async def test_kill_minus_nine_goes_unnoticed_by_the_board(
    master: Master, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A busy machine takes longer to start a bridge than a board is patient.
    monkeypatch.setattr(client_module, "_MOST_PINGS_LOST", 100)
    firmware = Firmware(gives_up=True)
    async with PtyBoard(firmware) as board, aio.NodeHandle("l", master=master.address) as looker:
        stamps: list[float] = []
        loop = asyncio.get_running_loop()
        await looker.subscribe("joint_states", JointState, lambda _: stamps.append(loop.time()))
        command = ("-m", "simple_ros_firmware_bridge", "--port", board.path)
        words = (*command, "--state", str(tmp_path))
        for _ in range(2):
            async with python(*words, SIMPLE_ROS_MASTER=master.address) as process:
                seen = len(stamps)
                await until(lambda seen=seen: len(stamps) > seen + 20, "samples")  # type: ignore[misc]
                os.kill(process.pid, signal.SIGKILL)
        assert firmware.client.stage is Stage.RUNNING
        assert firmware.client.counters.resets == 0
