"""``simple-ros launch`` as a user runs it."""

from __future__ import annotations

import json
import os
import pty
import re
import signal
import subprocess
import sys
import textwrap
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import psutil
import pytest
from support.cli import PROGRAM, run
from support.processes import Process, python
from support.waiting import Stopwatch, until

from simple_ros_master import Master

NODE = """\
from simple_ros import aio
async def main():
    async with aio.NodeHandle("camera") as node:
        print("here", flush=True)
        await node.spin()
aio.run(main())
"""
STAY = "import signal; signal.signal(15, signal.SIG_IGN); print('up', flush=True); signal.pause()"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SIMPLE_ROS_LOG_DIR", str(tmp_path / "log"))
    monkeypatch.setenv("SIMPLE_ROS_MASTER", "127.0.0.1:0")
    (tmp_path / "camera.py").write_text(NODE)
    (tmp_path / "stay.py").write_text(STAY)
    return tmp_path


def write(text: str) -> None:
    Path("robot.yaml").write_text(textwrap.dedent(text))


@asynccontextmanager
async def launched(text: str, until_said: str) -> AsyncIterator[tuple[Process, list[str]]]:
    write(text)
    async with python(*PROGRAM, "launch", "robot.yaml") as launch:
        lines = [await launch.line()]
        while until_said not in lines[-1]:
            lines.append(await launch.line())
        yield launch, lines


def without_numbers(text: str) -> str:
    return re.sub(r"\d+(\.\d+)?", "N", text)


async def test_it_starts_a_master_and_ends_all_on_ctrl_c(here: Path) -> None:
    text = "launch: [{node: camera, script: camera.py}, {node: x, script: stay.py, ready: started}]"
    async with launched(text, "camera: ready") as (launch, lines):
        assert lines[0].startswith(f"logs are in {here}/log/")
        assert [without_numbers(line) for line in lines[1:4]] == [
            "master: started (pid N)",
            "master: ready after N s",
            "camera: started (pid N)",
        ]
        children = psutil.Process(launch.pid).children(recursive=True)
        # It is ready as soon as the Master knows it, and says so a moment later.
        log = here / "log" / "latest" / "camera.log"
        await until(lambda: "here" in log.read_text().splitlines(), "its word")
        watch = Stopwatch()
        launch.signal(signal.SIGINT)
        assert await launch.wait() == 0
        assert watch.seconds < 5
        assert not any(child.is_running() for child in children)
        assert await launch.errors() == ""
    latest = here / "log" / "latest"
    assert latest.is_symlink()
    assert "here" in (latest / "camera.log").read_text().splitlines()
    assert "stopped" in (latest / "camera.log").read_text().splitlines()[-1]


async def test_a_running_master_is_used(here: Path, master: Master) -> None:
    write("launch: [{node: job, program: printenv, args: SIMPLE_ROS_MASTER, log: both}]")
    code, said, errors = await run("launch", "robot.yaml", SIMPLE_ROS_MASTER=master.address)
    assert (code, errors) == (0, "")
    assert [without_numbers(line) for line in said.splitlines()[1:]] == [
        "using the Master at N.N:N",
        "job: started (pid N)",
        "[job] N.N:N",
        "job: ended with code N",
        "over: all have ended",
    ]
    assert f"[job] {master.address}" in said.splitlines()


async def test_a_master_may_be_required(here: Path) -> None:
    write("launch: [{node: job, program: 'true'}]")
    nobody = "127.0.0.1:1"
    code, _, errors = await run(
        "launch", "robot.yaml", "--master", "require", SIMPLE_ROS_MASTER=nobody
    )
    assert code == 1
    assert errors.startswith(f"error: no Master answers at {nobody}")


async def test_a_required_process_that_fails_ends_all_with_its_last_lines(here: Path) -> None:
    write(
        """\
        launch:
          - {node: stays, script: stay.py, ready: "output:up"}
          - {node: bad, program: sh, args: [-c, "echo why; exit 4"], required: true, after: stays}
        """
    )
    code, said, errors = await run("launch", "robot.yaml")
    assert (code, errors) == (1, "")
    at = said.splitlines().index("bad: ended with code 4")
    assert said.splitlines()[at + 1] == "    why"
    assert "over: bad, which is required, was given up: ended with code 4" in said


async def test_programs_of_this_installation_are_found_without_a_path_to_them(here: Path) -> None:
    write("launch: [{node: version, program: simple-ros, args: [--version], required: true}]")
    _, said, errors = await run("launch", "robot.yaml", PATH="/usr/bin:/bin")
    assert errors == ""
    assert "version: ended with code 0" in said


async def test_all_end_when_the_launcher_is_killed(here: Path) -> None:
    text = "launch: [{node: x, script: stay.py, ready: 'output:up'}]"
    async with launched(text, "x: ready") as (launch, _):
        children = psutil.Process(launch.pid).children(recursive=True)
        launch.signal(signal.SIGKILL)
        await launch.wait()
        # The one that ignores SIGTERM is killed by the guard.
        await until(lambda: not any(map(lives, children)), "all to end")


def lives(process: psutil.Process) -> bool:
    try:
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


async def test_what_would_be_started(here: Path) -> None:
    write(
        "args: {n: {type: int, default: 1, description: Which.}}\nlaunch: [{node: a, program: p}]"
    )
    assert await run("launch", "robot.yaml", "--args") == (0, "n  int  = 1  Which.\n", "")
    code, said, _ = await run("launch", "robot.yaml", "n:=2", "--show")
    assert (code, said.splitlines()[:4]) == (
        0,
        ["file: robot.yaml", "", "a  (robot.yaml:2)", "  command: p"],
    )
    code, said, _ = await run("launch", "robot.yaml", "--json")
    assert json.loads(said)["processes"][0]["name"] == "a"
    code, _, errors = await run("launch", "robot.yaml", "m:=2")
    assert (code, errors) == (
        1,
        "error: command line: there is no argument 'm'; known are n\n",
    )


def test_on_a_terminal_there_is_a_table(here: Path) -> None:
    write("launch: [{node: talks, program: sh, args: [-c, 'echo the last word']}]")
    ours, theirs = pty.openpty()
    environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "100", "LINES": "24"}
    command = [sys.executable, *PROGRAM, "launch", "robot.yaml"]
    launch = subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs, env=environment)
    os.close(theirs)
    chunks = []
    try:
        while chunk := os.read(ours, 65536):
            chunks.append(chunk)
    except OSError:
        pass
    os.close(ours)
    assert launch.wait(30) == 0
    text = b"".join(chunks).decode()
    for word in ("process", "restarts", "last line", "talks", "master", "over: all have ended"):
        assert word in text
