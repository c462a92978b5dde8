"""What a launch file comes to: processes as values. Pure."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

from simple_ros.launch.arguments import Argument
from simple_ros.launch.errors import NOWHERE, LaunchFileError, Place, nearest
from simple_ros.launch.order import circle
from simple_ros.launch.restart import Respawn

__all__ = [
    "NO_LIMITS",
    "LaunchDescription",
    "Limits",
    "LogTo",
    "ProcessDescription",
    "Ready",
    "ReadyWhen",
    "check_processes",
    "to_json",
]


class ReadyWhen(Enum):
    """What makes a process ready."""

    NOTIFY = "notify"
    """It says so: `simple_ros.ready.ready`, or sd_notify's ``READY=1``."""
    REGISTERED = "registered"
    """A node of its name appears at the Master."""
    STARTED = "started"
    """It runs."""
    OUTPUT = "output"
    """It writes a line with a certain text."""
    ENDED = "ended"
    """It has ended with code 0: for jobs."""


@dataclass(frozen=True, slots=True)
class Ready:
    """When a process is ready.

    Attributes:
        text: Part of the line that is waited for, with `ReadyWhen.OUTPUT`.
    """

    when: ReadyWhen = ReadyWhen.STARTED
    text: str = ""

    def __str__(self) -> str:
        return f"output:{self.text}" if self.when is ReadyWhen.OUTPUT else self.when.value


class LogTo(Enum):
    """Where the output of a process goes, beside the last lines that are kept in memory."""

    FILE = "file"
    SCREEN = "screen"
    BOTH = "both"


@dataclass(frozen=True, slots=True)
class Limits:
    """What a process may take; None for what its launcher may.

    Attributes:
        memory_bytes: Of private memory (``RLIMIT_DATA``); more fails with MemoryError in Python.
        cpu_seconds: Of computing; then it is killed (``RLIMIT_CPU``).
        files: Open at a time (``RLIMIT_NOFILE``).
        nice: -20 (first) to 19 (last).
    """

    memory_bytes: int | None = None
    cpu_seconds: int | None = None
    files: int | None = None
    nice: int | None = None


NO_LIMITS = Limits()


@dataclass(frozen=True, slots=True)
class ProcessDescription:
    """One process.

    Attributes:
        name: Its node's canonical name, with the namespace.
        command: Program and arguments.
        words: ROS 1 style words for the node in it, for ``SIMPLE_ROS_ARGS``.
        environment: Variables to set, or to remove if None.
        cwd: Working directory; None for the launcher's.
        after: Names of processes that must be ready first.
        ready_timeout_s: After so long without being ready it is reported, and ends the launch if it
            is required.
        respawn: None to leave it ended.
        required: Whether its end ends everything.
        place: Where it is described.
    """

    name: str
    command: tuple[str, ...]
    words: tuple[str, ...] = ()
    environment: Mapping[str, str | None] = field(default_factory=dict)
    cwd: str | None = None
    ready: Ready = Ready()
    ready_timeout_s: float = 10.0
    after: tuple[str, ...] = ()
    respawn: Respawn | None = None
    required: bool = False
    limits: Limits = NO_LIMITS
    log: LogTo = LogTo.FILE
    place: Place = NOWHERE

    @property
    def variables(self) -> dict[str, str | None]:
        """The environment with the node's words in it."""
        own = {"SIMPLE_ROS_ARGS": shlex.join(self.words)} if self.words else {}
        return {**self.environment, **own}


@dataclass(frozen=True, slots=True)
class LaunchDescription:
    """What a launch file says once its arguments have values.

    Attributes:
        file: The file.
        arguments: As declared in it.
        files: All files that were read.
    """

    file: str
    arguments: tuple[Argument, ...]
    processes: tuple[ProcessDescription, ...]
    files: tuple[str, ...] = ()


def check_processes(processes: Iterable[ProcessDescription]) -> None:
    """See whether names are unique and the order is possible.

    Raises:
        LaunchFileError: They are not, or it is not.
    """
    known: dict[str, ProcessDescription] = {}
    for process in processes:
        if process.name in known:
            other = known[process.name].place
            raise LaunchFileError(
                process.place, f"node {process.name!r} is described in {other} already"
            )
        known[process.name] = process
    for process in known.values():
        for other_name in process.after:
            if other_name not in known:
                raise LaunchFileError(
                    process.place.under("after"),
                    f"there is no process {other_name!r}{nearest(other_name, known)}",
                )
    waiting = circle({name: process.after for name, process in known.items()})
    if waiting:
        way = " waits for ".join([*waiting, waiting[0]])
        raise LaunchFileError(known[waiting[0]].place.under("after"), f"{way}")


def to_json(description: LaunchDescription) -> dict[str, Any]:
    """The whole of it for programs."""
    return {
        "file": description.file,
        "files": list(description.files),
        "processes": [_process_json(process) for process in description.processes],
    }


def _process_json(process: ProcessDescription) -> dict[str, Any]:
    limits, respawn = process.limits, process.respawn
    return {
        "name": process.name,
        "command": list(process.command),
        "words": list(process.words),
        "environment": dict(process.environment),
        "cwd": process.cwd,
        "ready": str(process.ready),
        "ready_timeout": process.ready_timeout_s,
        "after": list(process.after),
        "respawn": respawn
        and {
            "limit": respawn.limit,
            "within": respawn.within_s,
            "delay": respawn.delay_s,
            "max_delay": respawn.max_delay_s,
            "always": respawn.always,
        },
        "required": process.required,
        "limits": {
            "memory": limits.memory_bytes,
            "cpu_seconds": limits.cpu_seconds,
            "files": limits.files,
            "nice": limits.nice,
        },
        "log": process.log.value,
        "file": process.place.file,
        "line": process.place.line,
    }
