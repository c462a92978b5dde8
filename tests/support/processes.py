"""Real processes for tests: a Master, and small node programs given as text."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import sys
import textwrap
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from support.waiting import LIMIT_S


class Process:
    """A Python child process whose standard output is read line by line."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self.process = process
        self.pid = process.pid

    async def line(self, limit: float = LIMIT_S) -> str:
        assert self.process.stdout is not None
        raw = await asyncio.wait_for(self.process.stdout.readline(), limit)
        if not raw:
            raise AssertionError(f"child ended: {await self.errors()}")
        return raw.decode().rstrip("\n")

    async def errors(self) -> str:
        assert self.process.stderr is not None
        return (await self.process.stderr.read()).decode()

    def signal(self, number: int) -> None:
        os.kill(self.pid, number)

    async def wait(self, limit: float = LIMIT_S) -> int:
        return await asyncio.wait_for(self.process.wait(), limit)

    async def kill(self) -> None:
        if self.process.returncode is None:
            # It may have ended and been reaped, with the word of it still on its way to us.
            with contextlib.suppress(ProcessLookupError):
                self.signal(signal.SIGKILL)
            await self.wait()


@asynccontextmanager
async def python(*args: str, **environment: str) -> AsyncIterator[Process]:
    child = await asyncio.create_subprocess_exec(
        sys.executable,
        "-u",
        *args,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        env=os.environ | environment,
    )
    process = Process(child)
    try:
        yield process
    finally:
        await process.kill()
        _, errors = await child.communicate()
        if errors:
            # Shown by pytest when a test fails.
            sys.stderr.write(errors.decode())


@asynccontextmanager
async def program(text: str, *args: str, master: str = "") -> AsyncIterator[Process]:
    """A node program; ``SIMPLE_ROS_MASTER`` tells it where the Master is."""
    async with python("-c", textwrap.dedent(text), *args, SIMPLE_ROS_MASTER=master) as process:
        yield process


@asynccontextmanager
async def master_process(port: int = 0) -> AsyncIterator[tuple[Process, str]]:
    """A Master of its own; gives the process and its address."""
    async with python("-m", "simple_ros_master", "--port", str(port)) as process:
        line = await process.line()
        yield process, line.rsplit(" ", 1)[1]
