"""Hubs in processes of their own, and what they tell."""

from __future__ import annotations

import contextlib
import os
import signal
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from simple_ros.aio import NodeHandle
from simple_ros.arguments import Arguments
from simple_ros.msg.wireless_ros_msgs import ComponentStatus, SystemEvent, SystemStatus
from simple_ros.qos import LATCHED
from simple_ros_master import Master
from support.processes import Process, python

SYNTHETIC = ("--set", "radio_info_engine.source=synthetic")


class Watcher:
    """Hears what a hub tells."""

    def __init__(self, node: NodeHandle) -> None:
        self.node = node
        self.statuses: list[SystemStatus] = []
        self.events: list[SystemEvent] = []
        self._since_ns = 0

    async def open(self) -> None:
        await self.node.subscribe(
            "/wireless_ros/system_status", SystemStatus, self._status, qos=LATCHED
        )
        await self.node.subscribe("/wireless_ros/system_events", SystemEvent, self.events.append)

    def _status(self, message: SystemStatus) -> None:
        if message.header.stamp.ToNanoseconds() >= self._since_ns:
            self.statuses.append(message)

    @property
    def newest(self) -> SystemStatus:
        return self.statuses[-1] if self.statuses else SystemStatus()

    def component(self, name: str) -> ComponentStatus:
        found = [item for item in self.newest.components if item.name == name]
        return found[0] if found else ComponentStatus()

    @property
    def pids(self) -> dict[str, int]:
        return {item.name: item.pid for item in self.newest.components}

    @property
    def operates(self) -> bool:
        return self.newest.phase == "OPERATION" and not self.newest.degraded

    def texts(self) -> list[str]:
        return [event.text for event in self.events]

    def forget(self) -> None:
        """Count only what is said from now on, not what a hub that has ended left under way."""
        self._since_ns = time.time_ns()
        self.statuses.clear()


@asynccontextmanager
async def watcher(master: Master) -> AsyncIterator[Watcher]:
    async with NodeHandle("watcher", master=master.address, arguments=Arguments()) as node:
        made = Watcher(node)
        await made.open()
        yield made


@asynccontextmanager
async def hub_process(
    master: Master, directory: Path, *words: str, **parameters: float
) -> AsyncIterator[Process]:
    """A hub; what it leaves running, `end_all` ends."""
    async with python(
        "-m",
        "simple_ros_hub",
        *words,
        SIMPLE_ROS_MASTER=master.address,
        SIMPLE_ROS_RUN_DIR=str(directory),
        SIMPLE_ROS_ARGS=" ".join(f"_{name}:={value}" for name, value in parameters.items()),
    ) as process:
        yield process


def is_alive(pid: int) -> bool:
    """Whether a process goes on, seen from here."""
    try:
        return "Z" not in Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False


def end_all(directory: Path) -> None:
    """Kill whatever hubs of this directory started."""
    for pid in started(directory):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(pid, signal.SIGKILL)


def started(directory: Path) -> list[int]:
    """Leaders of the groups that hubs of this directory started and that still run."""
    mark = f"SIMPLE_ROS_HUB_COMPONENT={directory}".encode()
    found = []
    for place in Path("/proc").iterdir():
        if place.name.isdigit():
            with contextlib.suppress(OSError):
                pid = int(place.name)
                if mark in (place / "environ").read_bytes() and os.getsid(pid) == pid:
                    found.append(pid)
    return found
