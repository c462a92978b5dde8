"""The command ``simple-ros demo wireless``: starts the programs, switches engines after the first round, plots."""

from __future__ import annotations

import asyncio
import importlib.util
import json
import logging
import math
import os
import signal
import sys
import tempfile
from collections.abc import Sequence
from contextlib import AsyncExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
import yaml

from simple_ros import aio
from simple_ros.demos.ports import free_port
from simple_ros.errors import SimpleRosError
from simple_ros.launch.child_process import ChildProcess, Command
from simple_ros_hub.demo.operator import NODE_NAME, Operator
from simple_ros_hub.demo.plot import Second, plot
from simple_ros_hub.demo.scenery import DEAD_ZONE, dead_shares

__all__ = ["wireless"]

_FOLDER = Path(__file__).parent
_STOP_WITHIN_S = 8.0
_LAYOUT = _FOLDER / "layout.json"
_HUB_WORDS = (
    "--set=radio_info_engine.source=link_shaper",
    "--set=command_cell.safe_distance=2.0",
    "--cell=camera,lidar,telemetry,command",
)
_NO_JPEG = (
    "Pillow is not installed: with engines on, pictures get smaller and fewer, but no JPEG "
    "(pip install 'simple-ros[camera]')"
)


class DemoFailed(SimpleRosError, RuntimeError):
    """One of the programs ended."""


def wireless(
    laps: Annotated[
        float, typer.Option(min=0, help="End after so many rounds; 0 for never.")
    ] = 0.0,
    speed: Annotated[
        float, typer.Option(min=1.0, max=20.0, metavar="M/S", help="How fast the robot drives.")
    ] = 4.0,
    plot_file: Annotated[
        Path,
        typer.Option(
            "--plot", dir_okay=False, help="Where the plot of both runs is left (SVG, and JSON)."
        ),
    ] = Path("wireless_demo.svg"),
    dashboard: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of the dashboard; the next free one.")
    ] = 8090,
    foxglove_port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of the Foxglove bridge; the next free one.")
    ] = 8765,
    no_foxglove: Annotated[
        bool, typer.Option("--no-foxglove", help="Start no Foxglove bridge.")
    ] = False,
    layout: Annotated[
        bool, typer.Option("--layout", help="Print a layout for Foxglove (JSON) and end.")
    ] = False,
) -> None:
    """Drive a robot through a simulated radio cell with a dead zone, at 30 % of the link.

    The first round is driven without engines, then they are switched on. A parameter switches them at any time;
    the plot of both runs is left behind. No radio is behind any number. Ctrl-C ends everything.
    """
    if layout:
        typer.echo(_LAYOUT.read_text(encoding="utf-8").rstrip())
        return
    # What is still on its way when the operator turns to other topics is no news.
    logging.getLogger("simple_ros.router").setLevel(logging.ERROR)
    bridge = None if no_foxglove else foxglove_port
    demo = WirelessDemo(laps or math.inf, speed)
    try:
        aio.run(demo.run(free_port(dashboard), bridge))
    except (SimpleRosError, OSError) as error:
        typer.echo(f"error: {error}", err=True)
        raise typer.Exit(1) from None
    finally:
        demo.leave_plot(plot_file)


class WirelessDemo:
    """One run of the demo.

    Args:
        laps: Rounds to drive.
        speed_mps: How fast.
    """

    def __init__(self, laps: float, speed_mps: float) -> None:
        self.seconds: list[Second] = []
        self._laps, self._speed_mps = laps, speed_mps
        self._has_jpeg = importlib.util.find_spec("PIL") is not None
        self._master = ""
        self._shaper = ""
        self._children: list[tuple[str, ChildProcess]] = []

    async def run(self, dashboard: int, foxglove_port: int | None) -> None:
        """Drive; all programs have ended when this returns or raises.

        Args:
            dashboard: Its port; 0 for any.
            foxglove_port: Of the bridge; None for none.

        Raises:
            DemoFailed: A program ended by itself.
        """
        if not self._has_jpeg:
            self._say(_NO_JPEG)
        async with AsyncExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            await self._start_programs(stack, folder, dashboard, foxglove_port)
            os.environ.update(self._environment("edge"))
            async with aio.NodeHandle(NODE_NAME, master=self._master) as node:
                operator = Operator(node, self._speed_mps, self._told, jpeg=self._has_jpeg)
                await operator.open()
                self._say(
                    f"engines are off; switch them: SIMPLE_ROS_MASTER={self._master} "
                    f"simple-ros param set /{NODE_NAME}/engines true"
                )
                ended = asyncio.create_task(self._first_end())
                driving = asyncio.create_task(self._drive(node, operator))
                try:
                    await asyncio.wait((ended, driving), return_when=asyncio.FIRST_COMPLETED)
                    await (ended if ended.done() else driving)
                finally:
                    ended.cancel()
                    driving.cancel()
                    await asyncio.gather(ended, driving, return_exceptions=True)

    async def _drive(self, node: aio.NodeHandle, operator: Operator) -> None:
        await operator.driven(min(1.0, self._laps))
        if not operator.engines and self._laps > 1:
            self._say("one round is driven; engines are switched on")
            await node.set_parameters({"~engines": True})
        await operator.driven(self._laps)

    def _told(self, second: Second) -> None:
        self.seconds.append(second)
        age = "none came" if second.pose_age_ms is None else f"{second.pose_age_ms:6.0f} ms"
        self._say(
            f"round {second.laps:5.2f}  engines {'on ' if second.engines else 'off'}  pose {age:>9}  "
            f"{second.pictures_hz:4.0f} pictures/s  {second.sensor_mbps:5.1f} Mbit/s  "
            f"{second.lost_percent:5.1f} % not in time"
        )

    def _say(self, line: str) -> None:
        typer.echo(line)

    def leave_plot(self, file: Path) -> None:
        """Write the plot and its numbers, if there are any."""
        if not self.seconds:
            return
        numbers = [asdict(second) for second in self.seconds]
        try:
            file.write_text(plot(self.seconds, dead_shares()), encoding="utf-8")
            file.with_suffix(".json").write_text(json.dumps(numbers, indent=1), encoding="utf-8")
        except OSError as error:
            typer.echo(f"error: no plot: {error}", err=True)
        else:
            self._say(f"both runs are plotted in {file}, their numbers are in {file.stem}.json")

    # -- programs ------------------------------------------------------------------------------

    def _environment(self, site: str) -> dict[str, str]:
        return {
            "SIMPLE_ROS_MASTER": self._master,
            "SIMPLE_ROS_TRANSPORTS": "local,shaped",
            "SIMPLE_ROS_SITE": site,
            "SIMPLE_ROS_LINK_SHAPER": self._shaper,
        }

    async def _start_programs(
        self, stack: AsyncExitStack, folder: Path, dashboard: int, foxglove_port: int | None
    ) -> None:
        tool = "simple_ros.cli.main"
        master = await self._start(stack, "master", ("simple_ros_master", "--port", "0"), {})
        self._master = (await self._line(master, "listening on ")).rpartition(" ")[2]
        plan = yaml.safe_load((_FOLDER / "shaper.yaml").read_text(encoding="utf-8"))
        plan["links"]["robot"]["channel"]["dead_zones"] = [list(DEAD_ZONE)]
        file = folder / "shaper.yaml"
        file.write_text(yaml.safe_dump({"listen": "127.0.0.1:0", **plan}), encoding="utf-8")
        at_master = ("--master", self._master)
        shaper = await self._start(
            stack, "link shaper", (tool, "link", "shape", str(file), *at_master), {}
        )
        self._shaper = (await self._line(shaper, "listening on ")).rpartition(" ")[2]
        robot = self._environment("robot")
        await self._start(stack, "robot", ("simple_ros_hub.demo.robot", *at_master), robot)
        image_format = "jpeg" if self._has_jpeg else "raw"
        words = (
            *("simple_ros_hub", *_HUB_WORDS, f"--set=camera_cell.image_format={image_format}"),
            *("--dashboard", str(dashboard), *at_master),
        )
        hub = await self._start(
            stack, "hub", words, {**robot, "SIMPLE_ROS_RUN_DIR": str(folder / "run")}
        )
        page = await self._line(hub, "Dashboard at ")
        self._say(f"dashboard: {page.rpartition('Dashboard at ')[2]}")
        if foxglove_port is not None:
            options = ("--port", str(free_port(foxglove_port)), *at_master)
            bridge = await self._start(
                stack, "foxglove", (tool, "foxglove", *options), self._environment("observer")
            )
            link = (await self._line(bridge, "open ")).partition("open ")[2]
            self._say(f"in Foxglove: open {link}; --layout prints a layout for it")

    async def _start(
        self, stack: AsyncExitStack, name: str, words: Sequence[str], more: dict[str, str]
    ) -> ChildProcess:
        # Words that name or remap this program are none of its children.
        environment: dict[str, str | None] = {"SIMPLE_ROS_ARGS": None, **more}
        child = await ChildProcess.start(Command((sys.executable, "-m", *words), environment))
        stack.push_async_callback(child.stop, [(signal.SIGTERM, _STOP_WITHIN_S)])
        self._children.append((name, child))
        return child

    async def _line(self, child: ChildProcess, text: str) -> str:
        line = await child.line_with(text)
        if line is None:
            raise await self._ended(child)
        return line

    async def _first_end(self) -> None:
        tasks = {asyncio.create_task(child.ended()): child for _, child in self._children}
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            raise await self._ended(tasks[done.pop()])
        finally:
            for task in tasks:
                task.cancel()

    async def _ended(self, child: ChildProcess) -> DemoFailed:
        await child.ended()
        name = next(name for name, one in self._children if one is child)
        last = child.last_lines[-1].strip() if child.last_lines else "it said nothing"
        return DemoFailed(f"{name} ended: {last}")
