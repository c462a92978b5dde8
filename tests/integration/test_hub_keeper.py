"""Processes that outlive their keeper, their limits and ends; the hub's directory."""

from __future__ import annotations

import os
import resource
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.hubs import end_all, is_alive, started
from support.waiting import until

from simple_ros.launch import Limits
from simple_ros_hub.components import Component, Kind
from simple_ros_hub.keeper import ProcessKeeper
from simple_ros_hub.place import HubRuns, Place, directory_for

SLEEPS = "import time; print('up', flush=True); time.sleep(100)"


def component(name: str, program: str = SLEEPS, limits: Limits | None = None) -> Component:
    command = (sys.executable, "-c", program)
    return Component(name, Kind.CELL, command, limits=limits or Limits())


class Kept:
    """A keeper and what it was told."""

    def __init__(self, directory: Path) -> None:
        self.ends: dict[str, str] = {}
        self.keeper = ProcessKeeper(directory, self.ends.__setitem__, "localhost:1")


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Path]:
    yield tmp_path
    end_all(tmp_path)


async def test_ends_are_told_with_the_last_line(place: Path) -> None:
    kept = Kept(place)
    kept.keeper.start(component("bad", "import sys; print('fine'); sys.exit('no camera')"))
    kept.keeper.start(component("good", "pass"))
    kept.keeper.start(component("killed"))
    kept.keeper.kill("killed")
    await until(lambda: len(kept.ends) == 3, "three ends")
    assert kept.ends == {
        "bad": "ended with code 1 (no camera)",
        "good": "ended with code 0",
        "killed": "killed by SIGKILL",
    }
    assert kept.keeper.log_path("bad").read_text() == "fine\nno camera\n"
    await kept.keeper.close(leave_running=False)


async def test_a_program_that_is_not_there(place: Path) -> None:
    kept = Kept(place)
    with pytest.raises(OSError, match="No such file"):
        kept.keeper.start(Component("ghost", Kind.CELL, ("/nowhere/ghost",)))
    await kept.keeper.close(leave_running=False)


async def test_what_it_started_ends_with_it_even_if_stopped(place: Path) -> None:
    spawn = (
        "import subprocess, sys, time\n"
        "child = subprocess.Popen(['sleep', '100'])\n"
        "print(child.pid, flush=True)\n"
        "time.sleep(100)\n"
    )
    kept = Kept(place)
    pid = kept.keeper.start(component("parent", spawn))
    await until(lambda: kept.keeper.last_line("parent"), "a child")
    child = int(kept.keeper.last_line("parent"))
    os.killpg(pid, signal.SIGSTOP)
    kept.keeper.kill("parent")
    await until(lambda: "parent" in kept.ends, "the end")
    await until(lambda: not is_alive(child), "the end of its child")
    await kept.keeper.close(leave_running=False)


async def test_another_keeper_takes_over(place: Path) -> None:
    first = Kept(place)
    pids = {name: first.keeper.start(component(name)) for name in ("one", "two")}
    await until(lambda: all(first.keeper.last_line(name) == "up" for name in pids), "running")
    await first.keeper.close(leave_running=True)
    elsewhere = Kept(place / "other")
    assert elsewhere.keeper.recover({name: component(name) for name in pids}) == {}
    second = Kept(place)
    assert second.keeper.recover({name: component(name) for name in pids}) == pids
    usage = second.keeper.usage("one")
    assert usage is not None
    assert usage.memory_bytes > 1_000_000
    os.kill(pids["one"], signal.SIGKILL)
    await until(lambda: "one" in second.ends, "its end")
    os.kill(pids["two"], signal.SIGSTOP)
    await second.keeper.close(leave_running=False)
    assert "two" in second.ends
    assert not is_alive(pids["two"])


async def test_what_is_not_known_any_more_is_ended(place: Path) -> None:
    first = Kept(place)
    pid = first.keeper.start(component("old"))
    await until(lambda: first.keeper.last_line("old") == "up", "running")
    await first.keeper.close(leave_running=True)
    second = Kept(place)
    assert second.keeper.recover({"new": component("new")}) == {}
    await until(lambda: not is_alive(pid), "its end")
    assert started(place) == []


async def test_limits_hold_for_one_process_only(place: Path) -> None:
    greedy = "block = bytearray(400_000_000)"
    # The last limit that is set: before that nothing is promised.
    limited = (
        "import os, time\n"
        "while os.getpriority(os.PRIO_PROCESS, 0) != 3: time.sleep(0.005)\n"
        f"{greedy}"
    )
    kept = Kept(place)
    limits = Limits(memory_bytes=200_000_000, files=64, nice=3)
    pid = kept.keeper.start(component("kept", limits=limits))
    assert os.getpriority(os.PRIO_PROCESS, pid) == 3
    assert resource.prlimit(pid, resource.RLIMIT_DATA)[0] == 200_000_000
    assert resource.prlimit(pid, resource.RLIMIT_NOFILE)[0] == 64
    kept.keeper.start(component("greedy", limited, limits))
    kept.keeper.start(component("free", greedy))
    await until(lambda: len(kept.ends) == 2, "two ends")
    assert kept.ends == {
        "greedy": "ended with code 1 (MemoryError)",
        "free": "ended with code 0",
    }
    await kept.keeper.close(leave_running=False)


def test_one_hub_a_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMPLE_ROS_RUN_DIR", str(tmp_path))
    directory = directory_for("robot:50051")
    assert directory == tmp_path / "hub-robot_50051"
    with Place(directory) as place:
        assert place.remembered() == {}
        place.remember({"policy": "HIGH_EFFICIENCY"})
        with pytest.raises(HubRuns, match=f"pid {os.getpid()}"):
            Place(directory)
    with Place(directory) as place:
        assert place.remembered() == {"policy": "HIGH_EFFICIENCY"}
        (directory / "state.json").write_text("{half")
        assert place.remembered() == {}
