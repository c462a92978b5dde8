"""The processes of a demo: started, watched and ended together; see `simple_ros.launch`."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Mapping, Sequence
from typing import Self

from simple_ros.errors import SimpleRosError
from simple_ros.launch.child_process import ChildProcess, Command
from simple_ros.launch.usage import Usage, UsageMeter

__all__ = ["DemoProcess", "ProcessEnded", "Processes", "Usage", "UsageMeter"]


class ProcessEnded(SimpleRosError, ChildProcessError):
    """A child process ended by itself.

    Attributes:
        name: Which one.
        state: How, in words.
        last_words: The last line of its stderr, or empty.
    """

    def __init__(self, name: str, state: str, last_words: str) -> None:
        self.name = name
        self.state = state
        self.last_words = last_words
        detail = f"; last line on its stderr: {last_words}" if last_words else ""
        super().__init__(f"{name} {state}{detail}")


class DemoProcess:
    """A running program with a name. Made by `Processes.start`."""

    def __init__(self, name: str, child: ChildProcess) -> None:
        self.name = name
        self.pid = child.pid
        self.meter = child.meter
        self._child = child

    @property
    def is_running(self) -> bool:
        """Whether it has not ended yet."""
        return self._child.is_running

    @property
    def state(self) -> str:
        """In words: running, or how it ended."""
        return self._child.state

    async def line_with(self, text: str) -> str:
        """The first line of its stdout that contains ``text``; waits for it.

        Raises:
            ProcessEnded: It ended without.
        """
        line = await self._child.line_with(text)
        if line is None:
            raise await self.ended()
        return line

    async def ended(self) -> ProcessEnded:
        """How it ended; waits for that."""
        await self._child.ended()
        lines = self._child.last_lines
        return ProcessEnded(self.name, self.state, lines[-1].strip() if lines else "")

    async def stop(self, grace_s: float) -> None:
        """Ask it to end with SIGTERM; after ``grace_s`` seconds end it with SIGKILL."""
        await self._child.stop([(signal.SIGTERM, grace_s)])


class Processes:
    """Children that end when the block does: ``async with Processes() as processes:``.

    Args:
        grace_s: How long a child may take to end before it is killed.
    """

    def __init__(self, grace_s: float = 2.0) -> None:
        self.children: list[DemoProcess] = []
        self._grace_s = grace_s

    async def start(
        self, name: str, command: Sequence[str], more: Mapping[str, str | None] | None = None
    ) -> DemoProcess:
        """Start a program.

        Args:
            name: What to call it.
            command: Program and arguments.
            more: Variables of its environment to set, or to remove if None.
        """
        # Words that name or remap this program are none of its children.
        environment = {"SIMPLE_ROS_ARGS": None, **(more or {})}
        child = await ChildProcess.start(
            Command(tuple(command), environment=environment), errors_apart=True
        )
        process = DemoProcess(name, child)
        self.children.append(process)
        return process

    async def first_end(self) -> ProcessEnded:
        """How the first child ended by itself; waits for that."""
        tasks = [asyncio.create_task(child.ended()) for child in self.children]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            return next(task.result() for task in tasks if task in done)
        finally:
            for task in tasks:
                task.cancel()

    async def stop(self) -> None:
        """End all, the last started first asked; returns when none is left."""
        await asyncio.gather(*(child.stop(self._grace_s) for child in reversed(self.children)))

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.stop()
