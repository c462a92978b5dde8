"""The hub's launch files, run by ``simple-ros launch``."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.hubs import end_all, is_alive, started, watcher
from support.processes import python
from support.waiting import until

import simple_ros_hub
from simple_ros.launch import describe
from simple_ros_master import Master

LAUNCH = Path(simple_ros_hub.__path__[0]) / "launch"
FILE = LAUNCH / "wireless_ros.yaml"
LONG_S = 60.0


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Path]:
    yield tmp_path
    end_all(tmp_path)


@pytest.mark.parametrize("chosen", ["standard", "quick", "frugal"])
def test_every_set_is_understood(chosen: str) -> None:
    (hub,) = describe(FILE, {"set": chosen, "max_users": "3"}).processes
    assert hub.name == "wireless_ros/hub"
    assert "_max_users:=3" in hub.words
    assert any(word.startswith("_policy_dwell:=") for word in hub.words)


async def test_launched_and_killed_and_ended(master: Master, place: Path) -> None:
    words = ("source:=synthetic", "cells:=telemetry", "max_total_prbs:=7", "radio_mode:=burst")
    async with (
        watcher(master) as seen,
        python(
            *("-m", "simple_ros.cli.main", "launch", "--master", "require", "--plain"),
            *(str(FILE), *words, "burst_interval:=0.2", "set:=quick"),
            SIMPLE_ROS_MASTER=master.address,
            SIMPLE_ROS_RUN_DIR=str(place / "run"),
            SIMPLE_ROS_LOG_DIR=str(place / "log"),
        ) as launcher,
    ):
        await until(lambda: seen.operates, "operation", LONG_S)
        # A policy may have chosen another mode since.
        assert "burst" in {item.mode for status in seen.statuses for item in status.components}
        assert await seen.node.get_parameter("/wireless_ros/hub/max_total_prbs") == 7
        before = seen.pids
        lock = next((place / "run").glob("hub-*")) / "hub.lock"
        hub = int(lock.read_text())
        os.kill(hub, signal.SIGKILL)
        await until(lambda: not is_alive(hub), "its end")
        seen.forget()
        await until(lambda: seen.operates, "operation of the next hub", LONG_S)
        assert seen.pids == before
        launcher.signal(signal.SIGINT)
        assert await launcher.wait() == 0
        assert started(place / "run") == []
