"""``simple-ros demo robot_xl``: a simulated robot drives a square, by the same programs as a real one."""

from __future__ import annotations

import asyncio
import math
import os
import sys
import tempfile
from pathlib import Path
from typing import Annotated

import typer

from simple_ros import aio
from simple_ros.errors import SimpleRosError
from simple_ros.msg.geometry_msgs import Twist
from simple_ros.msg.nav_msgs import Odometry

__all__ = ["robot_xl"]

_LAUNCH = Path(__file__).parent / "launch" / "robot_xl.yaml"
_SIDE_S = 2.5
_TURN_S = 2.0
_SPEED_M_S = 0.4
_PERIOD_S = 0.05


class NoRobot(SimpleRosError, RuntimeError):
    """The robot did not come up."""


def robot_xl(
    duration: Annotated[
        float, typer.Option(min=0, metavar="SECONDS", help="How long to drive; 0 for ever.")
    ] = 0.0,
    master: Annotated[
        str | None, typer.Option(metavar="HOST:PORT", help="Where the Master is.")
    ] = None,
) -> None:
    """Drive a square with a simulated mecanum robot: board, bridge and controller."""
    try:
        aio.run(_drive(duration or math.inf, master))
    except SimpleRosError as error:
        typer.echo(f"error: {error}", err=True)
        raise typer.Exit(1) from None


def _wanted(elapsed_s: float) -> Twist:
    """Ahead and a quarter turn to the left, in turns."""
    command = Twist()
    if elapsed_s % (_SIDE_S + _TURN_S) < _SIDE_S:
        command.linear.x = _SPEED_M_S
    else:
        command.angular.z = math.pi / 2 / _TURN_S
    return command


async def _drive(duration_s: float, master: str | None) -> None:
    environment = os.environ | ({} if master is None else {"SIMPLE_ROS_MASTER": master})
    directory = tempfile.TemporaryDirectory()
    link = f"link:={directory.name}/pico"
    words = ("launch", str(_LAUNCH), "simulated:=true", link, "--plain")
    robot = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "simple_ros.cli.main",
        *words,
        stdout=asyncio.subprocess.DEVNULL,
        env=environment,
    )
    try:
        async with aio.NodeHandle("square", master=master) as node:
            await _square(node, robot, duration_s)
    finally:
        if robot.returncode is None:
            robot.terminate()
        await robot.wait()
        directory.cleanup()


async def _square(
    node: aio.NodeHandle, robot: asyncio.subprocess.Process, duration_s: float
) -> None:
    latest: list[Odometry] = []
    await node.subscribe(
        "odometry/wheels", Odometry, lambda message: latest.__setitem__(slice(None), [message])
    )
    commands = await node.advertise("cmd_vel", Twist)
    loop = asyncio.get_running_loop()
    while not latest:
        if robot.returncode is not None:
            raise NoRobot("the programs of the robot ended; 'simple-ros launch' says why")
        await asyncio.sleep(_PERIOD_S)
    typer.echo("the robot drives a square; see it with 'simple-ros foxglove' (Ctrl-C ends)")
    begin, shown = loop.time(), 0
    while (elapsed := loop.time() - begin) < duration_s and robot.returncode is None:
        commands.publish(_wanted(elapsed))
        if elapsed >= shown:
            shown += 1
            typer.echo(_line(elapsed, latest[0]))
        await asyncio.sleep(_PERIOD_S)


def _line(elapsed_s: float, odometry: Odometry) -> str:
    pose = odometry.pose.pose
    yaw = 2 * math.degrees(math.atan2(pose.orientation.z, pose.orientation.w))
    return f"{elapsed_s:5.0f} s  x {pose.position.x:6.2f} m  y {pose.position.y:6.2f} m  {yaw:6.1f} deg"
