"""Child processes: started, watched and ended together.

Every child has a process group of its own, so that Ctrl-C in a terminal reaches only the parent,
which ends its children in order; and `exit_with_parent` sees to it that they end even when the
parent is killed and cannot.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import sys
from asyncio.subprocess import DEVNULL, PIPE, Process
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import psutil

from simple_ros.demos import exit_with_parent
from simple_ros.errors import SimpleRosError

__all__ = ["ChildProcess", "ProcessEnded", "Processes", "Usage", "UsageMeter"]

_KEPT_LINES = 20
_READ_BYTES = 65536
_LAST_WORDS_S = 0.5


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


@dataclass(frozen=True, slots=True)
class Usage:
    """What a process takes: share of one core in percent, resident memory in bytes."""

    cpu_percent: float
    memory_bytes: int


class UsageMeter:
    """Measures a process from outside."""

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self._process: psutil.Process | None = None

    def usage(self) -> Usage | None:
        """CPU since the last call (0 at the first), memory now; None when it has ended."""
        try:
            if self._process is None:
                self._process = psutil.Process(self._pid)
            return Usage(self._process.cpu_percent(), self._process.memory_info().rss)
        except psutil.Error:
            return None


class _Output:
    """The last lines of a stream; reading goes on whether or not anybody looks."""

    def __init__(self, stream: asyncio.StreamReader) -> None:
        self.lines: deque[str] = deque(maxlen=_KEPT_LINES)
        self.has_ended = False
        self.changed = asyncio.Event()
        self.task = asyncio.create_task(self._read(stream))

    async def _read(self, stream: asyncio.StreamReader) -> None:
        rest = b""
        while chunk := await stream.read(_READ_BYTES):
            *lines, rest = (rest + chunk).split(b"\n")
            self._add(lines)
            rest = rest[-_READ_BYTES:]
        self.has_ended = True
        self._add([rest])

    def _add(self, lines: Sequence[bytes]) -> None:
        texts = (line.decode(errors="replace").strip() for line in lines)
        self.lines.extend(text for text in texts if text)
        self.changed.set()


class ChildProcess:
    """A running program. Made by `Processes.start`."""

    def __init__(self, name: str, process: Process) -> None:
        assert process.stdout is not None
        assert process.stderr is not None
        self.name = name
        self.pid = process.pid
        self._process = process
        self._stdout = _Output(process.stdout)
        self._stderr = _Output(process.stderr)
        self.meter = UsageMeter(process.pid)

    @property
    def is_running(self) -> bool:
        """Whether it has not ended yet."""
        return self._process.returncode is None

    @property
    def state(self) -> str:
        """In words: running, or how it ended."""
        code = self._process.returncode
        if code is None:
            return "running"
        if code >= 0:
            return f"ended with code {code}"
        with contextlib.suppress(ValueError):
            return f"killed by {signal.Signals(-code).name}"
        return f"killed by signal {-code}"

    @property
    def last_words(self) -> str:
        """The last line of its stderr so far, or empty."""
        return self._stderr.lines[-1] if self._stderr.lines else ""

    async def line_with(self, text: str) -> str:
        """The first line of its stdout that contains ``text``; waits for it.

        Raises:
            ProcessEnded: It ended without.
        """
        output = self._stdout
        while True:
            for line in output.lines:
                if text in line:
                    return line
            if output.has_ended:
                raise await self.ended()
            output.changed.clear()
            await output.changed.wait()

    async def ended(self) -> ProcessEnded:
        """How it ended; waits for that."""
        await self._process.wait()
        # A grandchild may hold the pipe open for ever.
        await asyncio.wait((self._stdout.task, self._stderr.task), timeout=_LAST_WORDS_S)
        return ProcessEnded(self.name, self.state, self.last_words)

    async def stop(self, grace_s: float) -> None:
        """Ask it to end with SIGTERM; after ``grace_s`` seconds end it with SIGKILL."""
        if self.is_running:
            with contextlib.suppress(ProcessLookupError):
                self._process.terminate()
            try:
                await asyncio.wait_for(self._process.wait(), grace_s)
            except TimeoutError:
                with contextlib.suppress(ProcessLookupError):
                    self._process.kill()
        await self.ended()
        for output in (self._stdout, self._stderr):
            output.task.cancel()


class Processes:
    """Children that end when the block does: ``async with Processes() as processes:``.

    Args:
        grace_s: How long a child may take to end before it is killed.
    """

    def __init__(self, grace_s: float = 2.0) -> None:
        self.children: list[ChildProcess] = []
        self._grace_s = grace_s

    async def start(self, name: str, command: Sequence[str]) -> ChildProcess:
        """Start a program.

        Args:
            name: What to call it.
            command: Program and arguments.
        """
        launcher = [sys.executable, "-IS", exit_with_parent.__file__, str(os.getpid())]
        process = await asyncio.create_subprocess_exec(
            *launcher, *command, stdin=DEVNULL, stdout=PIPE, stderr=PIPE, process_group=0
        )
        child = ChildProcess(name, process)
        self.children.append(child)
        return child

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
