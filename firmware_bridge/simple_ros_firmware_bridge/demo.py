"""``simple-ros demo robot_xl``: a simulated robot drives a square, by the same programs as a real one."""

from __future__ import annotations

import asyncio
import math
import signal
import sys
import tempfile
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Annotated

import typer

from simple_ros import aio
from simple_ros.demos.ports import free_port
from simple_ros.errors import SimpleRosError
from simple_ros.launch.child_process import ChildProcess, Command
from simple_ros.msg.geometry_msgs import Twist
from simple_ros.msg.nav_msgs import Odometry
from simple_ros_firmware_bridge.control.messages import twist
from simple_ros_firmware_bridge.mecanum import Pose
from simple_ros_firmware_bridge.square import SquareDriver

__all__ = ["robot_xl"]

_LAUNCH = Path(__file__).parent / "launch" / "robot_xl.yaml"
_LAYOUT = _LAUNCH.with_name("robot_xl_layout.json")
_PERIOD_S = 0.05
_STOP_WITHIN_S = 8.0
_SILENT_S = 1.0


class NoRobot(SimpleRosError, RuntimeError):
    """The robot did not come up, or ended."""


def robot_xl(
    duration: Annotated[
        float, typer.Option(min=0, metavar="SECONDS", help="How long to drive; 0 for ever.")
    ] = 0.0,
    squares: Annotated[int, typer.Option(min=0, help="How many to drive; 0 for ever.")] = 0,
    foxglove_port: Annotated[
        int,
        typer.Option(
            min=0, max=65535, help="Port of the Foxglove bridge; the next free one if it is taken."
        ),
    ] = 8765,
    no_foxglove: Annotated[
        bool, typer.Option("--no-foxglove", help="Start no Foxglove bridge.")
    ] = False,
    layout: Annotated[
        bool, typer.Option("--layout", help="Print a layout for Foxglove (JSON) and end.")
    ] = False,
    master: Annotated[
        str | None, typer.Option(metavar="HOST:PORT", help="Where the Master is.")
    ] = None,
) -> None:
    """Drive a square with a simulated mecanum robot: board, bridge, controller, and a Foxglove bridge to look at it.

    A Master is started, too, if none is there. Ctrl-C ends everything.
    """
    if layout:
        typer.echo(_LAYOUT.read_text().rstrip())
        return
    words = [] if no_foxglove else ["foxglove:=true", f"foxglove_port:={free_port(foxglove_port)}"]
    try:
        aio.run(_run(words, master, duration or math.inf, squares or math.inf))
    except SimpleRosError as error:
        typer.echo(f"error: {error}", err=True)
        raise typer.Exit(1) from None


async def _run(words: list[str], master: str | None, duration_s: float, squares: float) -> None:
    async with _launched(words, master) as robot, aio.NodeHandle("square", master=master) as node:
        ended = asyncio.create_task(robot.ended())
        telling = asyncio.create_task(_tell_link(robot, is_wanted=bool(words)))
        driving = asyncio.create_task(_drive(node, duration_s, squares))
        try:
            await asyncio.wait((ended, driving), return_when=asyncio.FIRST_COMPLETED)
            if ended.done():
                last = robot.last_lines[-1].strip() if robot.last_lines else "it said nothing"
                raise NoRobot(f"the programs of the robot ended: {last}")
            await driving
        finally:
            for task in (ended, telling, driving):
                task.cancel()
            await asyncio.gather(ended, telling, driving, return_exceptions=True)


@asynccontextmanager
async def _launched(words: list[str], master: str | None) -> AsyncIterator[ChildProcess]:
    """The robot's programs, which end with this one, whatever ends it."""
    with tempfile.TemporaryDirectory() as directory:
        launch = (sys.executable, "-m", "simple_ros.cli.main", "launch", str(_LAUNCH), "--plain")
        # Words that name or remap this program are none of its children.
        environment: dict[str, str | None] = {"SIMPLE_ROS_ARGS": None}
        if master is not None:
            environment["SIMPLE_ROS_MASTER"] = master
        arguments = ("simulated:=true", f"link:={directory}/pico", *words)
        robot = await ChildProcess.start(Command((*launch, *arguments), environment))
        try:
            yield robot
        finally:
            await robot.stop([(signal.SIGTERM, _STOP_WITHIN_S)])


async def _tell_link(robot: ChildProcess, *, is_wanted: bool) -> None:
    if is_wanted and (line := await robot.line_with("open http")) is not None:
        typer.echo(
            f"in Foxglove: open {line.partition('open ')[2]}; --layout prints a layout for it"
        )


async def _drive(node: aio.NodeHandle, duration_s: float, squares: float) -> None:
    latest: asyncio.Queue[Odometry] = asyncio.Queue(1)

    def newest(message: Odometry) -> None:
        if latest.full():
            latest.get_nowait()
        latest.put_nowait(message)

    await node.subscribe("odometry/wheels", Odometry, newest)
    commands = await node.advertise("cmd_vel", Twist)
    await latest.get()
    typer.echo("the robot drives a square (Ctrl-C ends)")
    driver, loop = SquareDriver(), asyncio.get_running_loop()
    begin, shown, told = loop.time(), 0, 0
    while (elapsed := loop.time() - begin) < duration_s and driver.squares < squares:
        try:
            # asyncio.wait_for of Python 3.11 loses a Ctrl-C that comes together with a message.
            async with asyncio.timeout(_SILENT_S):
                pose = _pose(await latest.get())
        except TimeoutError:
            continue  # a robot that does not say where it is is not driven; its controller stops it
        commands.publish(twist(driver.command(pose)))
        if elapsed >= shown:
            shown += 1
            typer.echo(_line(elapsed, pose))
        if driver.squares > told:
            told = driver.squares
            typer.echo(f"square {told} closed, {driver.miss_m * 100:.1f} cm from where it began")
        await asyncio.sleep(_PERIOD_S)
    commands.publish(Twist())


def _pose(odometry: Odometry) -> Pose:
    where = odometry.pose.pose
    return Pose(
        where.position.x,
        where.position.y,
        2 * math.atan2(where.orientation.z, where.orientation.w),
    )


def _line(elapsed_s: float, pose: Pose) -> str:
    degrees = math.degrees(pose.yaw)
    return f"{elapsed_s:5.0f} s  x {pose.x:6.2f} m  y {pose.y:6.2f} m  {degrees:6.1f} deg"
