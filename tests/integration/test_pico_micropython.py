"""The MicroPython firmware, run by MicroPython on a pseudo terminal as on a Pico, and the real bridge."""

from __future__ import annotations

import asyncio
import logging
import os
import random
import shutil
import signal
import sys
import time
import tty
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from support.processes import python
from support.waiting import until

from simple_ros import aio
from simple_ros.msg.geometry_msgs import Twist
from simple_ros.msg.nav_msgs import Odometry
from simple_ros.msg.registry import MsgFactory
from simple_ros.msg.sensor_msgs import JointState
from simple_ros_firmware_bridge.bridge import PicoBridge
from simple_ros_firmware_bridge.config import BoardConfig
from simple_ros_master import Master

FOLDER = Path(__file__).parents[2] / "firmware_bridge" / "micropython"
MICROPYTHON = shutil.which("micropython") or shutil.which(
    "micropython", path=str(Path(sys.executable).parent)
)
HEAP = ("-X", "heapsize=192k")  # of 64-bit objects, twice as large as a Pico's

pytestmark = pytest.mark.skipif(
    MICROPYTHON is None,
    reason="needs micropython (its unix port) on the PATH",
)

STANDARD = {
    "joint_states": "sensor_msgs.JointState",
    "imu/data_raw": "sensor_msgs.Imu",
    "odom": "nav_msgs.Odometry",
    "sensors/range_tof": "sensor_msgs.Range",
    "sensors/range_ultrasonic": "sensor_msgs.Range",
    "sensors/illuminance": "sensor_msgs.Illuminance",
}


async def write_all(descriptor: int, data: bytes) -> None:
    """Writes without blocking, however full the line is: both ends need this loop or the board to read it."""
    loop = asyncio.get_running_loop()
    while data:
        try:
            data = data[os.write(descriptor, data) :]
        except BlockingIOError:
            room = asyncio.Event()
            loop.add_writer(descriptor, room.set)
            try:
                await room.wait()
            finally:
                loop.remove_writer(descriptor)


class Board:
    """A process of MicroPython whose stdin and stdout are a serial port."""

    process: asyncio.subprocess.Process

    def __init__(self, ours: int, theirs: int) -> None:
        self._ours = ours
        self._theirs = theirs
        self.path = os.ttyname(theirs)

    async def switch_on(self) -> None:
        assert MICROPYTHON is not None
        self.process = await asyncio.create_subprocess_exec(
            MICROPYTHON, *HEAP, "main.py", cwd=FOLDER, stdin=self._ours, stdout=self._ours
        )

    async def switch_off(self) -> None:
        if self.process.returncode is None:
            self.process.kill()
        await self.process.wait()

    async def noise_to_bridge(self, data: bytes) -> None:
        await write_all(self._ours, data)

    async def noise_to_board(self, data: bytes) -> None:
        await write_all(self._theirs, data)


@asynccontextmanager
async def port() -> AsyncIterator[Board]:
    """A port with a board that is not switched on yet."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    os.set_blocking(ours, False)
    os.set_blocking(theirs, False)
    try:
        yield Board(ours, theirs)
    finally:
        os.close(ours)
        os.close(theirs)


@asynccontextmanager
async def running(board: Board) -> AsyncIterator[None]:
    await board.switch_on()
    try:
        yield
    finally:
        await board.switch_off()


@asynccontextmanager
async def running_board() -> AsyncIterator[Board]:
    async with port() as board, running(board):
        yield board


@asynccontextmanager
async def bridged(master: Master, board: Board) -> AsyncIterator[aio.NodeHandle]:
    """A bridge on the port of the board, and a node to look on."""
    async with aio.NodeHandle("pico_bridge", master=master.address) as node:
        async with PicoBridge(node, [BoardConfig(board.path)]):
            async with aio.NodeHandle("looker", master=master.address) as looker:
                yield looker


async def collect(node: aio.NodeHandle, topic: str, message_class: type[Any]) -> list[Any]:
    found: list[Any] = []
    await node.subscribe(topic, message_class, found.append)
    return found


async def test_every_topic_of_the_robot_is_there_with_its_type_and_values(
    master: Master, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    async with port() as board, bridged(master, board) as looker, AsyncExitStack() as stack:
        # What a board says before its port is opened is lost.
        await until(lambda: "is open" in caplog.text, "the open port")
        await stack.enter_async_context(running(board))
        found = {
            topic: await collect(looker, topic, MsgFactory.instance().get_class(type_name))
            for topic, type_name in STANDARD.items()
        }
        await until(lambda: all(found.values()), "a message on every topic")
        joints = found["joint_states"][-1]
        assert list(joints.name) == [
            f"{end}_{side}_wheel_joint" for end in ("front", "rear") for side in ("left", "right")
        ]
        assert (len(joints.position), len(joints.velocity)) == (4, 4)
        imu = found["imu/data_raw"][-1]
        assert imu.linear_acceleration.z == pytest.approx(9.8, abs=0.1)
        assert imu.orientation_covariance[0] == -1
        assert found["odom"][-1].child_frame_id == "base_link"
        assert found["sensors/range_ultrasonic"][-1].range == pytest.approx(2)
        assert found["sensors/range_tof"][-1].range == float("inf")
        assert found["sensors/illuminance"][-1].illuminance == pytest.approx(300, abs=10)

        def is_stamped_now() -> bool:
            stamp_s = found["joint_states"][-1].header.stamp.ToNanoseconds() / 1e9
            return stamp_s == pytest.approx(time.time(), abs=1)

        await until(is_stamped_now, "a stamp of this moment")
        assert "says: pico: SIMULATED robot" in caplog.text


async def test_cmd_vel_turns_the_wheels_and_its_end_stops_them(master: Master) -> None:
    async with running_board() as board, bridged(master, board) as looker:
        odometry: list[Odometry] = await collect(looker, "odom", Odometry)
        joints: list[JointState] = await collect(looker, "joint_states", JointState)
        commands = await looker.advertise("cmd_vel", Twist)
        await commands.wait_for_subscribers(timeout=30)
        drive = Twist()
        drive.linear.x, drive.angular.z = 0.2, 0.5
        timer = looker.create_timer(0.05, lambda _: commands.publish(drive))

        def is_driving() -> bool:
            last = odometry[-1] if odometry else Odometry()
            twist, pose = last.twist.twist, last.pose.pose
            left, right = joints[-1].velocity[:2] if joints else (0, 0)
            return (
                right > left > 0
                and twist.linear.x == pytest.approx(0.2, abs=0.03)
                and twist.angular.z == pytest.approx(0.5, abs=0.1)
                and pose.position.x > 0.1
                and pose.orientation.z > 0.1
            )

        await until(is_driving, "that motion")
        timer.close()
        await until(lambda: not any(joints[-1].velocity), "standstill")


async def test_kill_minus_nine_of_the_bridge_goes_unnoticed(master: Master, tmp_path: Path) -> None:
    async with running_board() as board, aio.NodeHandle("l", master=master.address) as looker:
        joints: list[JointState] = await collect(looker, "joint_states", JointState)
        words = ("-m", "simple_ros_firmware_bridge", "--port", board.path)
        logs = []
        for _ in range(3):
            async with python(
                *words, "--state", str(tmp_path), SIMPLE_ROS_MASTER=master.address
            ) as bridge:
                seen = len(joints)
                await until(lambda seen=seen: len(joints) > seen + 20, "samples")  # type: ignore[misc]
                os.kill(bridge.pid, signal.SIGKILL)
                logs.append(await bridge.errors())
        assert "connected (client key" in logs[0]
        assert "connected (client key" not in logs[1] + logs[2]
        # A bridge that remembers nothing: the board notices by itself and begins anew.
        async with python(*words, "--no-keep", SIMPLE_ROS_MASTER=master.address):
            seen = len(joints)
            await until(lambda: len(joints) > seen + 20, "samples")
        assert board.process.returncode is None


async def test_garbage_on_the_line(master: Master) -> None:
    rng = random.Random(13)
    async with running_board() as board, bridged(master, board) as looker:
        joints: list[JointState] = await collect(looker, "joint_states", JointState)
        await until(lambda: len(joints) > 10, "samples")
        for _ in range(100):
            await board.noise_to_board(rng.randbytes(500))
            await board.noise_to_bridge(rng.randbytes(50))
            seen = len(joints)
            await until(lambda seen=seen: len(joints) > seen, "a sample")  # type: ignore[misc]
        commands = await looker.advertise("cmd_vel", Twist)
        drive = Twist()
        drive.linear.x = 0.2
        looker.create_timer(0.05, lambda _: commands.publish(drive))
        await until(lambda: min(joints[-1].velocity) > 1, "motion")
        assert board.process.returncode is None


async def test_ctrl_c_ends_it_when_nobody_talks_to_it() -> None:
    async with running_board() as board:
        await board.noise_to_board(b"\r\x03")
        assert await asyncio.wait_for(board.process.wait(), 30) == 0
