"""What supervision knows and says, as values. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from simple_ros.launch.restart import RestartHistory
from simple_ros_hub.components import Component

__all__ = ["Action", "Do", "Happening", "Phase", "State", "SupervisionSettings", "View"]


class Phase(Enum):
    """How far the start is."""

    DISCOVERY = "DISCOVERY"
    INITIALIZATION = "INITIALIZATION"
    OPERATION = "OPERATION"


class State(Enum):
    """How a component is."""

    WAITING = "waiting"
    STARTING = "starting"
    ACTIVE = "active"
    DEGRADED = "degraded"
    HUNG = "hung"
    RESTARTING = "restarting"
    GIVEN_UP = "given up"
    STOPPING = "stopping"
    STOPPED = "stopped"


class Do(Enum):
    """What the shell is to do with a component's process."""

    START = "start"
    STOP = "stop"
    KILL = "kill"


@dataclass(frozen=True, slots=True)
class Action:
    """To be carried out now."""

    do: Do
    name: str


@dataclass(frozen=True, slots=True)
class Happening:
    """For the event log.

    Attributes:
        component: Whom it is about; empty for the hub.
        text: What happened.
        is_error: Whether that is bad.
    """

    component: str
    text: str
    is_error: bool = False


@dataclass(frozen=True, slots=True)
class SupervisionSettings:
    """Settings.

    Attributes:
        hung_after_s: Silence of a component that worked, after which it is killed.
        inactive_after_s: The same for one that is no process of ours: then one of ours is started.
        discovery_s: How long to listen for what is there already.
        discovery_timeout_s: DISCOVERY ends then at the latest.
        initialization_timeout_s: INITIALIZATION ends then at the latest.
        recovery_enabled: Whether anything is started again.
    """

    hung_after_s: float = 2.0
    inactive_after_s: float = 5.0
    discovery_s: float = 1.2
    discovery_timeout_s: float = 5.0
    initialization_timeout_s: float = 30.0
    recovery_enabled: bool = True


@dataclass(slots=True)
class View:
    """What is known of a component.

    Attributes:
        component: What it is.
        state: How it is.
        message: More of that, in words.
        pid: Its process; 0: none of ours.
        restarts: How often it was started again.
        heard_s: When its last sign of life came; None: never in this run.
        settled: Whether those that come after it need not wait for it any more.
    """

    component: Component
    state: State = State.WAITING
    message: str = ""
    pid: int = 0
    restarts: int = 0
    heard_s: float | None = None
    settled: bool = False
    begun_s: float = 0.0
    due_s: float | None = None
    why: str = ""
    again: bool = False
    history: RestartHistory = field(default_factory=lambda: RestartHistory(None))

    @property
    def works(self) -> bool:
        """Whether it does its work, well or less well."""
        return self.state in (State.ACTIVE, State.DEGRADED)
