"""What happens to a supervised process, as values. Pure."""

from __future__ import annotations

import contextlib
import signal
from dataclasses import dataclass

__all__ = [
    "Ended",
    "Exit",
    "GivenUp",
    "IsReady",
    "NotReady",
    "ProcessEvent",
    "Restarting",
    "Started",
    "Stopping",
]


@dataclass(frozen=True, slots=True)
class Exit:
    """How a process ended.

    Attributes:
        code: Its exit code; the negative number of the signal that killed it.
        problem: Why it could not even be started, or empty.
    """

    code: int
    problem: str = ""

    @property
    def is_good(self) -> bool:
        """Whether it ended with code 0."""
        return self.code == 0

    def __str__(self) -> str:
        if self.problem:
            return f"could not be started: {self.problem}"
        if self.code >= 0:
            return f"ended with code {self.code}"
        with contextlib.suppress(ValueError):
            return f"killed by {signal.Signals(-self.code).name}"
        return f"killed by signal {-self.code}"


@dataclass(frozen=True, slots=True)
class ProcessEvent:
    """Something happened to a process.

    Attributes:
        name: Which one.
    """

    name: str


@dataclass(frozen=True, slots=True)
class Started(ProcessEvent):
    """It runs; ``restarts`` counts how often it was started again by itself."""

    pid: int
    restarts: int

    def __str__(self) -> str:
        again = f", restart {self.restarts}" if self.restarts else ""
        return f"{self.name}: started (pid {self.pid}{again})"


@dataclass(frozen=True, slots=True)
class IsReady(ProcessEvent):
    """It is ready, ``after_s`` seconds after its start."""

    after_s: float

    def __str__(self) -> str:
        return f"{self.name}: ready after {self.after_s:.2f} s"


@dataclass(frozen=True, slots=True)
class NotReady(ProcessEvent):
    """Its ``ready_timeout`` is over and it is not ready; it goes on running.

    Attributes:
        waited_for: What would have made it ready.
        waiting: Those that cannot start without it.
    """

    after_s: float
    waited_for: str
    waiting: tuple[str, ...]

    def __str__(self) -> str:
        others = f"; {', '.join(self.waiting)} cannot start" if self.waiting else ""
        return f"{self.name}: not ready after {self.after_s:g} s (ready: {self.waited_for}){others}"


@dataclass(frozen=True, slots=True)
class Stopping(ProcessEvent):
    """It was asked to end."""

    def __str__(self) -> str:
        return f"{self.name}: stopping"


@dataclass(frozen=True, slots=True)
class Ended(ProcessEvent):
    """It has ended.

    Attributes:
        exit: How.
        expected: Whether it was asked to.
    """

    exit: Exit
    expected: bool

    def __str__(self) -> str:
        return f"{self.name}: {'stopped, ' if self.expected else ''}{self.exit}"


@dataclass(frozen=True, slots=True)
class Restarting(ProcessEvent):
    """It will be started again after ``delay_s``; restart ``number`` of ``limit`` that count."""

    delay_s: float
    number: int
    limit: int

    def __str__(self) -> str:
        return f"{self.name}: restarting in {self.delay_s:g} s ({self.number} of {self.limit})"


@dataclass(frozen=True, slots=True)
class GivenUp(ProcessEvent):
    """It failed and will not be started again."""

    reason: str

    def __str__(self) -> str:
        return f"{self.name}: given up: {self.reason}"
