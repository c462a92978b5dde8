"""The supervisor with real processes."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import psutil
import pytest
from support.waiting import until

from simple_ros.launch import (
    Ended,
    GivenUp,
    Limits,
    ProcessDescription,
    ProcessEvent,
    Ready,
    ReadyWhen,
    Respawn,
    Started,
    State,
    Supervisor,
)
from simple_ros_master import Master

STAY = "import signal; print('up'); signal.pause()"
UP = Ready(ReadyWhen.OUTPUT, "up")


class Watched(Supervisor):
    """A supervisor whose events are kept."""

    def __init__(self, log_directory: Path | None = None) -> None:
        self.events: list[ProcessEvent] = []
        super().__init__(self.events.append, log_directory=log_directory)

    def kinds(self, name: str) -> list[str]:
        return [type(event).__name__ for event in self.events if event.name == name]

    async def in_state(self, name: str, state: State) -> None:
        await until(lambda: self.status(name).state is state, f"{name} {state.value}")

    def run(self, name: str, code: str, **more: object) -> None:
        command = (sys.executable, "-uc", code)
        self.add(ProcessDescription(name, command, **more))  # type: ignore[arg-type]
        self.start(name)


@asynccontextmanager
async def supervising(log_directory: Path | None = None) -> AsyncIterator[Watched]:
    async with Watched(log_directory) as supervisor:
        yield supervisor


def is_gone(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


async def test_start_stop_restart_kill() -> None:
    async with supervising() as supervisor:
        supervisor.run("a", STAY, ready=UP)
        await supervisor.in_state("a", State.RUNNING)
        first = supervisor.status("a").pid
        assert os.getpgid(first) == first
        usage = supervisor.usage("a")
        assert usage is not None
        assert usage.memory_bytes > 0
        await supervisor.restart("a")
        await supervisor.in_state("a", State.RUNNING)
        assert supervisor.status("a").pid != first
        with pytest.raises(ValueError, match="'a' runs"):
            supervisor.run("a", STAY)
        await supervisor.stop("a")
        assert supervisor.status("a").detail in ("killed by SIGINT", "ended with code 1")
        supervisor.start("a")
        await supervisor.in_state("a", State.RUNNING)
        await supervisor.kill("a")
        assert supervisor.status("a").detail == "killed by SIGKILL"
        assert not supervisor.has_failed


async def test_one_that_crashes_at_its_start_is_given_up(tmp_path: Path) -> None:
    async with supervising(tmp_path) as supervisor:
        policy = Respawn(limit=2, delay_s=0.01)
        supervisor.run("x/bad", "print('so'); exit(3)", respawn=policy)
        await supervisor.in_state("x/bad", State.GIVEN_UP)
        run = ["Started", "IsReady", "Ended", "Restarting"]
        assert supervisor.kinds("x/bad") == [*run, *run, *run[:3], "GivenUp"]
        assert supervisor.last_lines("x/bad") == ("so",)
    lines = (tmp_path / "x-bad.log").read_text().splitlines()
    assert lines.count("so") == 3
    reason = "given up: ended with code 3, restarted 2 times within 60 s of running"
    assert lines[-1].startswith("[launch ")
    assert lines[-1].endswith(reason)


async def test_killed_from_outside_it_comes_back() -> None:
    async with supervising() as supervisor:
        supervisor.run("a", STAY, ready=UP, respawn=Respawn(delay_s=0.01))
        await supervisor.in_state("a", State.RUNNING)
        supervisor.signal("a", signal.SIGKILL)
        await until(lambda: supervisor.status("a").restarts == 1)
        await supervisor.in_state("a", State.RUNNING)


async def test_order_by_notification_and_by_registration(master: Master) -> None:
    says = "from simple_ros.ready import ready; import signal; print(ready()); signal.pause()"
    node = """
from simple_ros import aio
async def main():
    async with aio.NodeHandle("seen") as node:
        await node.spin()
aio.run(main())
"""
    async with supervising() as supervisor:
        supervisor.use_master(master.address)
        seen = Ready(ReadyWhen.REGISTERED)
        supervisor.run("first", says, ready=Ready(ReadyWhen.NOTIFY))
        supervisor.run("seen", node, after=("first",), ready=seen)
        supervisor.run("last", STAY, after=("seen",), ready=UP)
        await supervisor.in_state("last", State.RUNNING)
        # It says so after it has told.
        await until(lambda: supervisor.last_lines("first") == ("True",), "its word")
        kinds = [(event.name, type(event).__name__) for event in supervisor.events]
        pairs = [
            (name, kind) for name in ("first", "seen", "last") for kind in ("Started", "IsReady")
        ]
        assert kinds == pairs
        await supervisor.kill("seen")
        supervisor.start("seen")
        await supervisor.in_state("seen", State.RUNNING)


async def test_who_heeds_no_signal_is_killed_and_grandchildren_end_too() -> None:
    stubborn = """
import signal, subprocess, sys
for number in (signal.SIGINT, signal.SIGTERM):
    signal.signal(number, signal.SIG_IGN)
code = "import signal; print('up', flush=True); signal.pause()"
near = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.DEVNULL)
far = subprocess.Popen([sys.executable, "-c", code], start_new_session=True)
print("pids", near.pid, far.pid)
signal.pause()
"""
    async with supervising() as supervisor:
        supervisor.run("a", stubborn, ready=UP)
        await supervisor.in_state("a", State.RUNNING)
        await until(lambda: any("pids" in line for line in supervisor.last_lines("a")))
        (line,) = (line for line in supervisor.last_lines("a") if "pids" in line)
        pids = [int(word) for word in line.split()[1:]]
        await supervisor.stop("a", [(signal.SIGINT, 0.05), (signal.SIGTERM, 0.05)])
        assert supervisor.status("a").detail == "killed by SIGKILL"
        await until(lambda: all(map(is_gone, pids)), "grandchildren to end")


async def test_what_a_process_leaves_behind_ends_with_it() -> None:
    code = "import subprocess; print('pid', subprocess.Popen(['sleep', '100']).pid)"
    async with supervising() as supervisor:
        supervisor.run("a", code)
        await supervisor.in_state("a", State.ENDED)
        left = int(supervisor.last_lines("a")[0].split()[1])
        await until(lambda: is_gone(left), "its child to end")


async def test_limits_directory_and_environment(tmp_path: Path) -> None:
    code = """
import os, resource
print(resource.getrlimit(resource.RLIMIT_NOFILE)[0], os.nice(0), os.getcwd(), os.environ["A"])
print(resource.getrlimit(resource.RLIMIT_CPU)[0], "HOME" in os.environ)
bytearray(500_000_000)
"""
    async with supervising() as supervisor:
        limits = Limits(memory_bytes=100_000_000, cpu_seconds=7, files=64, nice=5)
        place = {"limits": limits, "cwd": str(tmp_path)}
        supervisor.run("a", code, environment={"A": "1", "HOME": None}, **place)
        await supervisor.in_state("a", State.GIVEN_UP)
        lines = supervisor.last_lines("a")
        assert lines[:2] == (f"64 5 {tmp_path} 1", "7 False")
        assert lines[-1] == "MemoryError"


@pytest.mark.parametrize(
    ("command", "cwd", "said"),
    [
        ("/no/such/program", None, "cannot run /no/such/program: No such file or directory"),
        ("true", "/no/such", "cannot set cwd to /no/such: No such file or directory"),
    ],
)
async def test_what_cannot_run_says_why(command: str, cwd: str | None, said: str) -> None:
    async with supervising() as supervisor:
        supervisor.add(ProcessDescription("a", (command,), cwd=cwd))
        supervisor.start("a")
        await supervisor.in_state("a", State.GIVEN_UP)
        assert supervisor.last_lines("a") == (said,)
        ended = [event for event in supervisor.events if isinstance(event, Ended)]
        assert ended[0].exit.code in (126, 127)


async def test_a_late_one_is_told_and_goes_on() -> None:
    async with supervising() as supervisor:
        notify = Ready(ReadyWhen.NOTIFY)
        supervisor.run("a", STAY, ready=notify, ready_timeout_s=0.02)
        await until(lambda: "NotReady" in supervisor.kinds("a"))
        assert supervisor.status("a").state is State.STARTING
        assert type(supervisor.events[0]) is Started
        assert not any(isinstance(event, GivenUp) for event in supervisor.events)
