"""Measurements of the control loop of robot_xl, over the bridge, on a simulated board."""

from __future__ import annotations

import asyncio
import contextlib
import random
import time

from pico_tools import Place, Row, latency_rows, program, until

from simple_ros import aio
from simple_ros.msg.geometry_msgs import Twist
from simple_ros_firmware_bridge.control.lifecycle import State
from simple_ros_firmware_bridge.control.manager import ControllerManager
from simple_ros_firmware_bridge.control.settings import declared_settings
from simple_ros_firmware_bridge.mecanum import BodySpeed
from simple_ros_firmware_bridge.simulator.firmware import Firmware
from simple_ros_firmware_bridge.simulator.pty_board import PtyBoard

_COMMANDS = 400
_DIRECT = ("--remap", "cmd_vel:=hardware/cmd_vel")


async def loop(place: Place) -> list[Row]:
    """From a command to the motors: pilot, controller, bridge and board; all but the first and last are programs."""
    firmware = Firmware(key=b"ctrl")
    arrived = asyncio.Event()
    wanted = 0.0
    obey = firmware.robot.command

    def note(body: BodySpeed, now: float) -> None:
        obey(body, now)
        if (body.vx > 0) == (wanted > 0):
            arrived.set()

    firmware.robot.command = note  # type: ignore[method-assign]
    controller = ("-m", "simple_ros.cli.main", "pico", "controller", "--master", place.master)
    took: list[float] = []
    rng = random.Random(3)
    async with (
        PtyBoard(firmware) as board,
        aio.NodeHandle("pilot", master=place.master) as pilot,
        program(*place.bridge(board, *_DIRECT)),
        program(*controller),
    ):
        commands = await pilot.advertise("cmd_vel", Twist)
        await commands.wait_for_subscribers(timeout=20)
        await asyncio.wait_for(arrived.wait(), 20)
        for number in range(_COMMANDS):
            # Commands come at any phase of the loop.
            await asyncio.sleep(0.02 + 0.01 * rng.random())
            wanted = 0.02 if number % 2 == 0 else 0.0
            arrived.clear()
            message = Twist()
            message.linear.x = wanted
            begin = time.perf_counter()
            while not arrived.is_set():  # a command that came while the robot was down is forgotten
                commands.publish(message)
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(arrived.wait(), 0.1)
            took.append(time.perf_counter() - begin)
    return latency_rows("cmd_vel to the motors, loop at 100 Hz", took, 20)


async def hardware(place: Place) -> list[Row]:
    """How long the hardware interface takes: `read`, and `write` with the publishing of it."""
    reads: list[float] = []
    writes: list[float] = []
    ticks: list[float] = []
    async with (
        PtyBoard(Firmware(key=b"hard")) as board,
        program(*place.bridge(board, *_DIRECT)),
        aio.NodeHandle("controller_manager", master=place.master) as node,
    ):
        manager = await ControllerManager.create(node, await declared_settings(node))
        read, tell, tick = manager._read, manager._tell, manager.tick
        manager._read = _timed(read, reads)  # type: ignore[method-assign]
        manager._tell = _timed(tell, writes)  # type: ignore[method-assign]
        await until(lambda: manager.lifecycles["RobotSystem"].state is State.ACTIVE)
        timed = _timed(tick, ticks)
        timer = node.create_timer(0.01, lambda _: timed())
        await asyncio.sleep(place.short_s)
        timer.stop()
        await manager.close()
    return [
        *latency_rows("hardware interface, read", reads, 10),
        *latency_rows("hardware interface, write", writes, 10),
        *latency_rows("one period of the loop: read, decide, write, odometry, tf", ticks),
    ]


def _timed(call, times: list[float]):  # type: ignore[no-untyped-def]
    def timed(*args: object) -> object:
        begin = time.perf_counter()
        try:
            return call(*args)
        finally:
            times.append(time.perf_counter() - begin)

    return timed
