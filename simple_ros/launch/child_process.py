"""One child process: started, heard, ended with everything it started.

Every child has a process group of its own, so that Ctrl-C in a terminal reaches only the parent,
which ends its children in order; `become` and `guard` see to it that they end even when the parent is
killed and cannot.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import sys
import sysconfig
from asyncio.subprocess import DEVNULL, STDOUT, Process
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field

import psutil

from simple_ros.launch import become
from simple_ros.launch.description import NO_LIMITS, Limits
from simple_ros.launch.events import Exit
from simple_ros.launch.output import Output
from simple_ros.launch.usage import UsageMeter

__all__ = ["GENTLY", "ChildProcess", "Command", "StopStep"]

StopStep = tuple[signal.Signals, float]
GENTLY: tuple[StopStep, ...] = ((signal.SIGINT, 1.5), (signal.SIGTERM, 1.0))
"""How a child is ended: signals, and the seconds it gets after each. SIGKILL follows."""

_LAST_WORDS_S = 0.5
_ORPHAN_LOOKS = 50
_LOOK_EVERY_S = 0.01


@dataclass(frozen=True, slots=True)
class Command:
    """What to run.

    Attributes:
        words: Program and arguments.
        environment: Variables to set, or to remove if None; the others are inherited.
        cwd: Working directory; None for this process's.
    """

    words: tuple[str, ...]
    environment: Mapping[str, str | None] = field(default_factory=dict)
    cwd: str | None = None
    limits: Limits = NO_LIMITS

    def launcher(self, parent: int) -> list[str]:
        """The words that really are run, see `become`."""
        wishes = [] if self.cwd is None else [f"cwd={self.cwd}"]
        numbers = {"memory": self.limits.memory_bytes, **asdict(self.limits)}
        del numbers["memory_bytes"]
        wishes += [f"{name}={value}" for name, value in numbers.items() if value is not None]
        return [sys.executable, "-IS", become.__file__, str(parent), *wishes, "--", *self.words]

    def variables(self) -> dict[str, str]:
        """The whole environment; the programs of this installation are found last, if not before."""
        merged = {**os.environ, **self.environment}
        path = merged.get("PATH") or os.defpath
        scripts = sysconfig.get_path("scripts")
        if scripts not in path.split(os.pathsep):
            merged["PATH"] = os.pathsep.join((path, scripts))
        return {name: value for name, value in merged.items() if value is not None}


class ChildProcess:
    """A running program. Made by `start`."""

    def __init__(self, process: Process, outputs: Sequence[Output]) -> None:
        self.pid = process.pid
        self.meter = UsageMeter(process.pid)
        self._process = process
        self._outputs = outputs
        self._ending: asyncio.Task[Exit] | None = None

    @classmethod
    async def start(
        cls,
        command: Command,
        on_lines: Callable[[Sequence[str]], None] | None = None,
        *,
        errors_apart: bool = False,
    ) -> ChildProcess:
        """Start a program.

        Args:
            command: What to run; if that is not possible its output says so and it ends with
                code 126 or 127.
            on_lines: Called with its lines as they come.
            errors_apart: Keep the last lines of stderr apart from those of stdout; otherwise they
                are one stream, in order.

        Raises:
            OSError: The system starts no more processes.
        """
        outputs = [Output(on_lines) for _ in range(2 if errors_apart else 1)]
        ends = [await output.open() for output in outputs]
        try:
            process = await asyncio.create_subprocess_exec(
                *command.launcher(os.getpid()),
                stdin=DEVNULL,
                stdout=ends[0],
                stderr=ends[1] if errors_apart else STDOUT,
                env=command.variables(),
                process_group=0,
            )
        finally:
            for end in ends:
                os.close(end)
        return cls(process, outputs)

    @property
    def is_running(self) -> bool:
        """Whether it has not ended yet."""
        return self._process.returncode is None

    @property
    def state(self) -> str:
        """In words: running, or how it ended."""
        code = self._process.returncode
        return "running" if code is None else str(Exit(code))

    @property
    def last_lines(self) -> Sequence[str]:
        """The last lines of its output so far; of stderr where that is apart."""
        return tuple(self._outputs[-1].lines)

    async def line_with(self, text: str) -> str | None:
        """The first line of its stdout that contains ``text``; waits for it.

        None if it ended without.
        """
        return await self._outputs[0].line_with(text)

    async def ended(self) -> Exit:
        """How it ended; waits for that, and until everything in its group has ended, too."""
        if self._ending is None:
            self._ending = asyncio.create_task(self._end())
        return await asyncio.shield(self._ending)

    async def _end(self) -> Exit:
        code = await self._process.wait()
        await self._end_orphans()
        await asyncio.gather(*(output.close(_LAST_WORDS_S) for output in self._outputs))
        return Exit(code)

    async def _end_orphans(self) -> None:
        if self._signal_group(signal.SIGTERM):
            # Only a process's own parent is told of its end; these have lost theirs.
            for _ in range(_ORPHAN_LOOKS):
                if not self._signal_group(0):
                    return
                await asyncio.sleep(_LOOK_EVERY_S)
            self._signal_group(signal.SIGKILL)

    def _signal_group(self, number: int) -> bool:
        """Send a signal to its group; whether anybody is in it."""
        try:
            os.killpg(self.pid, number)
        except (ProcessLookupError, PermissionError):
            return False
        return True

    def signal(self, number: int) -> None:
        """Send a signal to it and what it started; nothing if it has ended."""
        if self.is_running:
            self._signal_group(number)

    async def stop(self, steps: Sequence[StopStep] = GENTLY) -> Exit:
        """End it and what it started, with SIGKILL if the steps before do not.

        Args:
            steps: Signals, each with the seconds it gets then; with none it is killed at once.
        """
        strays = self._descendants()
        for number, patience_s in steps:
            if not self.is_running:
                break
            self.signal(number)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(patience_s):
                    await self._process.wait()
        self.signal(signal.SIGKILL)
        how = await self.ended()
        # Some made a group of their own; psutil knows them again by the time of their start.
        for stray in strays:
            with contextlib.suppress(psutil.Error):
                stray.kill()
        return how

    def _descendants(self) -> list[psutil.Process]:
        if not self.is_running:
            return []
        try:
            return psutil.Process(self.pid).children(recursive=True)
        except psutil.Error:
            return []
