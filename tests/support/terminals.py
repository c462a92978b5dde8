"""The reader of a page at the terminals: runs its shell sessions and compares what they print."""

from __future__ import annotations

import asyncio
import os
import re
import shlex
import signal
import sys
from pathlib import Path

from simple_ros_master import Master
from support.pages import Block, Command, session_of, shape_of
from support.waiting import until

# What a reader does once, and the tests have done already.
DONE = re.compile(r"^(python3 -m venv|\. |pip install|mkdir|cd|simple-ros-master)\b")
# What `topic hz` says on a machine so busy that a second passes with no message.
NOT_YET = "not enough messages yet"


class Terminals:
    """Runs the sessions of a page as its reader would, in a directory with the page's files."""

    def __init__(self, directory: Path, master: Master) -> None:
        self._directory = directory
        self._master = master
        self._environment = os.environ | {
            "SIMPLE_ROS_MASTER": master.address,
            "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
            "PYTHONUNBUFFERED": "1",
            "COLUMNS": "80",
        }
        self._running: dict[int, Run] = {}

    async def run(self, block: Block) -> None:
        session = session_of(block)
        await self.leave(session.terminal)
        for command in session.commands:
            if DONE.match(command.text):
                continue
            last = command is session.commands[-1]
            stays = session.terminal != 0 and last and command.stays
            self._running[session.terminal] = await self._started(command)
            await self._watch(self._running[session.terminal], stays=stays)
            if command.interrupted:
                await self.leave(session.terminal)
            elif not stays:
                await self._running.pop(session.terminal).ended()

    async def _started(self, command: Command) -> Run:
        process = await asyncio.create_subprocess_exec(
            *shlex.split(command.text),
            cwd=self._directory,
            env=self._environment,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
        )
        return Run(command, process)

    async def _watch(self, run: Run, *, stays: bool) -> None:
        """Read what is expected; what stays and prints nothing is there when the Master knows it."""
        before = self._nodes()
        for expected in run.command.output:
            found = await run.line()
            while found == NOT_YET != expected:
                found = await run.line()
            assert shape_of(found) == shape_of(expected), str(run)
        if stays and not run.command.output:
            await until(
                lambda: self._nodes() - before or run.has_ended,
                f"{run} to register",
            )

    def _nodes(self) -> set[str]:
        """Those that publish or subscribe."""
        nodes = self._master.graph.nodes()
        return {node.name for node in nodes if node.publishes or node.subscribes}

    async def leave(self, terminal: int) -> None:
        """Ctrl-C, if something runs there."""
        run = self._running.pop(terminal, None)
        if run is not None:
            await run.interrupted()

    async def leave_all(self) -> None:
        for terminal in sorted(self._running):
            await self.leave(terminal)

    async def kill_all(self) -> None:
        for run in self._running.values():
            await run.kill()


class Run:
    """A command that was started."""

    def __init__(self, command: Command, process: asyncio.subprocess.Process) -> None:
        self.command = command
        self._process = process

    def __str__(self) -> str:
        return f"line {self.command.line}: {self.command.text}"

    @property
    def has_ended(self) -> bool:
        return self._process.returncode is not None

    async def line(self) -> str:
        assert self._process.stdout is not None
        raw = await asyncio.wait_for(self._process.stdout.readline(), 30)
        return raw.decode().rstrip("\n")

    async def ended(self) -> None:
        """It ends by itself, having printed all; with code 1 if it printed an error, else 0."""
        rest, _ = await asyncio.wait_for(self._process.communicate(), 30)
        assert rest.decode() == "", str(self)
        refused = any(line.startswith("error: ") for line in self.command.output)
        assert self._process.returncode == int(refused), str(self)

    async def interrupted(self) -> None:
        """It ends quietly on Ctrl-C, or has ended."""
        if not self.has_ended:
            self._process.send_signal(signal.SIGINT)
        rest, _ = await asyncio.wait_for(self._process.communicate(), 30)
        assert (self._process.returncode, "Traceback" in rest.decode()) == (0, False), (
            f"{self}\n{rest.decode()}"
        )

    async def kill(self) -> None:
        if not self.has_ended:
            self._process.kill()
        await self._process.communicate()
