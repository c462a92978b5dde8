"""The processes of the soak, and what is seen of them."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import sys
import time
from pathlib import Path

import psutil
import yaml
from soak_model import COMPONENTS
from soak_robot import DEAD_ZONE

import simple_ros_hub
from simple_ros import aio
from simple_ros.demos.ports import free_port
from simple_ros.launch.child_process import ChildProcess, Command
from simple_ros.msg.std_msgs import Bool, Int64
from simple_ros.msg.wireless_ros_msgs import SystemEvent, SystemStatus
from simple_ros.qos import LATCHED, QosProfile

LAUNCH = Path(simple_ros_hub.__path__[0]) / "launch" / "wireless_ros.yaml"
HERE = Path(__file__).parent
NODES = {f"wireless_ros/{name}" for name in (*COMPONENTS, "hub")} | {"soak_robot", "soak_operator"}
SHAPER = {
    "listen": "127.0.0.1:0",
    "carrier": {"scs_khz": 30, "bandwidth_mhz": 20},
    "classes": [
        {"name": "command", "topics": ["/robot/pose", "/cmd_vel/*"], "priority": 5},
        {"name": "sensors", "topics": ["/camera/*", "/lidar/*"], "priority": 2},
    ],
    "links": {
        "robot": {
            "rnti": 0x4601,
            "pose_topic": "/robot/pose",
            "channel": {
                "kind": "radio",
                "station_m": [0, 0],
                "route_m": [[30, 0]],
                "speed_mps": 0,
                "dead_zones": [list(DEAD_ZONE)],
            },
        }
    },
}


class NotWithin(Exception):
    """Something took too long."""


async def until(condition, what: str, limit_s: float) -> float:
    """Seconds until it is so.

    Raises:
        NotWithin: It is not.
    """
    begun = time.monotonic()
    while not condition():
        if time.monotonic() - begun > limit_s:
            raise NotWithin(f"not within {limit_s:g} s: {what}")
        await asyncio.sleep(0.02)
    return time.monotonic() - begun


class World:
    """The processes."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.children: dict[str, ChildProcess] = {}
        self.master = f"127.0.0.1:{free_port(23450)}"
        self.shaper = ""

    async def start(self) -> None:
        await self.start_master()
        plan = self.folder / "shaper.yaml"
        plan.write_text(yaml.safe_dump(SHAPER))
        shaper = await self.child("shaper", "-m", "simple_ros.cli.main", "link", "shape", str(plan))
        line = await shaper.line_with("listening on ")
        self.shaper = line.rpartition(" ")[2]
        await self.child("robot", str(HERE / "soak_robot.py"), "robot", site="robot")
        await self.child("operator", str(HERE / "soak_robot.py"), "operator", site="edge")
        await self.child(
            "launch",
            *("-m", "simple_ros.cli.main", "launch", "--master", "require", "--plain", str(LAUNCH)),
            *("source:=link_shaper", "cells:=camera,lidar,telemetry,command"),
            *("check_interval:=0.25", "log:=file"),
            site="robot",
        )

    async def start_master(self) -> None:
        port = self.master.rpartition(":")[2]
        child = await self.child("master", "-m", "simple_ros_master", "--port", port)
        if await child.line_with("listening on ") is None:
            raise RuntimeError("the Master did not start")

    async def child(self, name: str, *words: str, site: str = "") -> ChildProcess:
        environment: dict[str, str | None] = {
            "SIMPLE_ROS_ARGS": None,
            "SIMPLE_ROS_MASTER": self.master,
            "SIMPLE_ROS_RUN_DIR": str(self.folder / "run"),
            "SIMPLE_ROS_LOG_DIR": str(self.folder / "log"),
        }
        if site:
            environment |= {
                "SIMPLE_ROS_TRANSPORTS": "local,shaped",
                "SIMPLE_ROS_SITE": site,
                "SIMPLE_ROS_LINK_SHAPER": self.shaper,
            }
        self.children[name] = await ChildProcess.start(
            Command((sys.executable, *words), environment)
        )
        return self.children[name]

    @property
    def place(self) -> Path:
        return next((self.folder / "run").glob("hub-*"), self.folder / "run")

    @property
    def hub_pid(self) -> int:
        with contextlib.suppress(OSError, StopIteration, ValueError):
            pid = int((self.place / "hub.lock").read_text())
            if psutil.pid_exists(pid):
                return pid
        return 0

    def components(self) -> list[tuple[str, int]]:
        """As the kernel has them, not as the hub says; a name twice is two processes."""
        found = []
        for process in psutil.process_iter():
            with contextlib.suppress(psutil.Error, OSError):
                mark = process.environ().get("SIMPLE_ROS_HUB_COMPONENT", "")
                place, _, name = mark.rpartition(":")
                leads = os.getsid(process.pid) == process.pid
                if place == str(self.place) and leads and process.status() != "zombie":
                    found.append((name, process.pid))
        return sorted(found)

    def table(self) -> list[tuple[str, int]]:
        ours = [(name, child.pid) for name, child in self.children.items()]
        return sorted([*ours, ("hub", self.hub_pid), *self.components()])

    async def stop(self) -> None:
        for name in ("launch", "operator", "robot", "shaper", "master"):
            if name in self.children:
                await self.children[name].stop([(signal.SIGINT, 15.0)])


class Watch:
    """What the hub and the operator tell."""

    def __init__(self, node: aio.NodeHandle) -> None:
        self.node = node
        self.status = SystemStatus()
        self.at = 0.0
        self.events: list[int] = []
        self.counts: dict[str, int] = {}

    async def open(self) -> None:
        node = self.node
        await node.subscribe("/wireless_ros/system_status", SystemStatus, self.took, qos=LATCHED)
        await node.subscribe(
            "/wireless_ros/system_events",
            SystemEvent,
            lambda event: self.events.append(event.number),
            qos=QosProfile(depth=1000),
        )
        for name in ("pictures", "clouds", "tracks"):
            await node.subscribe(f"/soak/{name}", Int64, lambda m, n=name: self.counted(n, m.data))
        self.dead = await node.advertise("/soak/dead", Bool, qos=LATCHED)
        self.dead.publish(Bool(data=False))

    def took(self, status: SystemStatus) -> None:
        self.status, self.at = status, time.monotonic()

    def counted(self, name: str, count: int) -> None:
        self.counts[name] = count

    def pid(self, name: str) -> int:
        return next((item.pid for item in self.status.components if item.name == name), 0)

    @property
    def operates(self) -> bool:
        status = self.status
        return (
            status.phase == "OPERATION"
            and not status.degraded
            and len(status.components) == len(COMPONENTS)
            and time.monotonic() - self.at < 1.0
        )
