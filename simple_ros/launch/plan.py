"""Which process may start, restart or is given up. Pure: reports and time in, starts and events out.

The shell around it starts what `take_starts` names, reports what became of it (`started`, `ready`,
`ended`), and calls `handle_timeout` at `next_timeout`.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from enum import Enum

from simple_ros.launch.description import ProcessDescription, ReadyWhen
from simple_ros.launch.errors import UnknownProcess
from simple_ros.launch.events import (
    Ended,
    Exit,
    GivenUp,
    IsReady,
    NotReady,
    ProcessEvent,
    Restarting,
    Started,
    Stopping,
)
from simple_ros.launch.restart import GiveUp, RestartHistory, RestartIn

__all__ = ["Plan", "State", "Status", "Verdict"]


class State(Enum):
    """Where a process is in its life."""

    IDLE = "not started"
    WAITING = "waiting"
    STARTING = "starting"
    RUNNING = "running"
    STOPPING = "stopping"
    RESTARTING = "restarting"
    ENDED = "ended"
    GIVEN_UP = "given up"


_ALIVE = (State.STARTING, State.RUNNING, State.STOPPING)
_OVER = (State.ENDED, State.GIVEN_UP)


@dataclass(frozen=True, slots=True)
class Status:
    """What is known about a process.

    Attributes:
        pid: 0 if it does not run.
        restarts: How often it was started again by itself.
        detail: What it waits for, how it ended or why it was given up; or empty.
    """

    name: str
    state: State
    pid: int
    restarts: int
    detail: str


@dataclass(frozen=True, slots=True)
class Verdict:
    """Why a launch is over."""

    reason: str
    has_failed: bool


@dataclass(slots=True)
class _Life:
    """The mutable state of one process."""

    description: ProcessDescription
    history: RestartHistory
    state: State = State.IDLE
    pid: int = 0
    restarts: int = 0
    began: float = 0.0
    due: float = math.inf
    was_ready: bool = False
    is_late: bool = False
    was_stopped: bool = False
    starts_again: bool = False
    detail: str = ""


@dataclass(slots=True)
class Plan:
    """The processes of one supervisor."""

    _lives: dict[str, _Life] = field(default_factory=dict)
    _starts: list[str] = field(default_factory=list)
    _events: list[ProcessEvent] = field(default_factory=list)

    def add(self, description: ProcessDescription) -> None:
        """Know a process; one of the same name that does not run is replaced."""
        history = RestartHistory(description.respawn)
        self._lives[description.name] = _Life(description, history)

    def description(self, name: str) -> ProcessDescription:
        """What a process is.

        Raises:
            UnknownProcess: There is none of that name.
        """
        return self._life(name).description

    def is_alive(self, name: str) -> bool:
        """Whether it runs or is about to."""
        return self._life(name).state in _ALIVE

    # -- wishes --------------------------------------------------------------------------------

    def start(self, name: str) -> None:
        """Start it as soon as those it comes after are ready; what was counted is forgotten.

        Nothing if it runs; one that is being stopped starts again when it has ended.
        """
        life = self._life(name)
        if life.state is State.STOPPING:
            life.starts_again = True
        elif life.state not in _ALIVE:
            life.history.forget()
            life.restarts, life.was_ready, life.was_stopped = 0, False, False
            self._wait(life)

    def stop(self, name: str) -> None:
        """It is being ended, or shall not start: whatever comes of it is no failure."""
        life = self._life(name)
        life.starts_again = False
        if life.state in (State.STARTING, State.RUNNING):
            life.state, life.due = State.STOPPING, math.inf
            life.was_stopped = True
            self._events.append(Stopping(name))
        elif life.state in (State.WAITING, State.RESTARTING):
            life.state, life.due, life.detail = State.ENDED, math.inf, "stopped"
            life.was_stopped = True
            self._starts = [other for other in self._starts if other != name]

    # -- reports -------------------------------------------------------------------------------

    def started(self, name: str, pid: int, now: float) -> None:
        """Its process runs."""
        life = self._life(name)
        life.pid, life.began = pid, now
        self._events.append(Started(name, pid, life.restarts))
        if life.state is not State.STARTING:
            return
        ready = life.description.ready
        if ready.when is ReadyWhen.STARTED:
            self._become_ready(life, now)
        elif ready.when is not ReadyWhen.ENDED:
            life.due = now + life.description.ready_timeout_s

    def ready(self, name: str, now: float) -> None:
        """What makes it ready has happened."""
        life = self._life(name)
        if life.state is State.STARTING:
            self._become_ready(life, now)

    def ended(self, name: str, how: Exit, now: float) -> None:
        """Its process has ended, or could not be started."""
        life = self._life(name)
        ran_s = now - life.began if life.pid else 0.0
        stopped = life.state is State.STOPPING
        life.pid, life.due, life.detail = 0, math.inf, str(how)
        self._events.append(Ended(name, how, stopped))
        respawn = life.description.respawn
        if stopped:
            life.state = State.ENDED
            if life.starts_again:
                life.starts_again = False
                self.start(name)
        elif how.is_good and not (respawn and respawn.always):
            life.state, life.was_ready, life.is_late = State.ENDED, True, False
            self._start_followers()
        else:
            self._failed(life, how, ran_s, now)

    def next_timeout(self) -> float | None:
        """When `handle_timeout` wants to be called; None for never."""
        due = min((life.due for life in self._lives.values()), default=math.inf)
        return None if due == math.inf else due

    def handle_timeout(self, now: float) -> None:
        """Time has passed."""
        for life in self._lives.values():
            if life.due > now:
                continue
            life.due = math.inf
            if life.state is State.RESTARTING:
                life.restarts += 1
                self._begin(life)
            elif life.state is State.STARTING:
                self._report_late(life)

    # -- what comes of it ----------------------------------------------------------------------

    def take_starts(self) -> list[str]:
        """Names of the processes to start now, each once."""
        starts, self._starts = self._starts, []
        return starts

    def take_events(self) -> list[ProcessEvent]:
        """What has happened since the last call."""
        events, self._events = self._events, []
        return events

    def statuses(self) -> list[Status]:
        """All processes, in the order they were added."""
        return [
            Status(name, life.state, life.pid, life.restarts, life.detail)
            for name, life in self._lives.items()
        ]

    def status(self, name: str) -> Status:
        """One process.

        Raises:
            UnknownProcess: There is none of that name.
        """
        life = self._life(name)
        return Status(name, life.state, life.pid, life.restarts, life.detail)

    def verdict(self, background: Collection[str] = ()) -> Verdict | None:
        """Whether a launch of these is over.

        Args:
            background: Names that nobody waits for.
        """
        for name, life in self._lives.items():
            if life.description.required and (reason := _required_reason(life)):
                return Verdict(
                    f"{name}, which is required, {reason}", life.state is not State.ENDED
                )
        counted = [life for name, life in self._lives.items() if name not in background]
        if any(life.state not in _OVER for life in counted):
            return None
        lost = [life.description.name for life in counted if life.state is State.GIVEN_UP]
        if lost:
            return Verdict(f"given up: {', '.join(lost)}", has_failed=True)
        return Verdict("all have ended", has_failed=False)

    @property
    def has_failed(self) -> bool:
        """Whether any process was given up."""
        return any(life.state is State.GIVEN_UP for life in self._lives.values())

    # -- inside --------------------------------------------------------------------------------

    def _life(self, name: str) -> _Life:
        try:
            return self._lives[name]
        except KeyError:
            raise UnknownProcess(name, self._lives) from None

    def _wait(self, life: _Life) -> None:
        """Begin, or wait for those it comes after."""
        open_names = [other.description.name for other in self._awaited(life)]
        lost = [name for name in open_names if self._lives[name].state is State.GIVEN_UP]
        if lost:
            self._give_up(life, f"it comes after {lost[0]}, which was given up")
        elif open_names:
            life.state, life.detail = State.WAITING, f"for {', '.join(open_names)}"
        else:
            self._begin(life)

    def _awaited(self, life: _Life) -> Iterator[_Life]:
        for name in life.description.after:
            other = self._life(name)
            if not other.was_ready:
                yield other

    def _begin(self, life: _Life) -> None:
        life.state, life.detail, life.is_late = State.STARTING, "", False
        life.due = math.inf
        self._starts.append(life.description.name)

    def _become_ready(self, life: _Life, now: float) -> None:
        life.state, life.due, life.detail = State.RUNNING, math.inf, ""
        life.was_ready, life.is_late = True, False
        self._events.append(IsReady(life.description.name, now - life.began))
        self._start_followers()

    def _start_followers(self) -> None:
        for life in self._lives.values():
            if life.state is State.WAITING:
                self._wait(life)

    def _failed(self, life: _Life, how: Exit, ran_s: float, now: float) -> None:
        match life.history.failed(ran_s):
            case RestartIn(delay_s, number, limit):
                life.state, life.due = State.RESTARTING, now + delay_s
                life.detail = f"{how}; in {delay_s:g} s ({number} of {limit})"
                name = life.description.name
                self._events.append(Restarting(name, delay_s, number, limit))
            case GiveUp(reason):
                self._give_up(life, f"{how}, {reason}")

    def _give_up(self, life: _Life, reason: str) -> None:
        life.state, life.detail, life.due = State.GIVEN_UP, reason, math.inf
        self._events.append(GivenUp(life.description.name, reason))
        self._start_followers()

    def _report_late(self, life: _Life) -> None:
        description = life.description
        life.is_late = True
        life.detail = f"not ready after {description.ready_timeout_s:g} s"
        waiting = tuple(
            other.description.name
            for other in self._lives.values()
            if other.state is State.WAITING and description.name in other.description.after
        )
        self._events.append(
            NotReady(description.name, description.ready_timeout_s, str(description.ready), waiting)
        )


def _required_reason(life: _Life) -> str:
    if life.state is State.GIVEN_UP:
        return f"was given up: {life.detail}"
    if life.state is State.ENDED and not life.was_stopped:
        return life.detail
    return life.detail if life.is_late and life.state is State.STARTING else ""
