"""Lifecycle of a hardware interface or controller, as in ROS 2: what may happen in which state."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import Enum

from simple_ros.errors import SimpleRosError

__all__ = ["InvalidTransition", "Lifecycle", "State"]


class State(Enum):
    """Where it is."""

    UNCONFIGURED = "unconfigured"
    INACTIVE = "inactive"
    ACTIVE = "active"
    FINALIZED = "finalized"


_TABLE: Mapping[tuple[State, str], State] = {
    (State.UNCONFIGURED, "configure"): State.INACTIVE,
    (State.INACTIVE, "activate"): State.ACTIVE,
    (State.INACTIVE, "cleanup"): State.UNCONFIGURED,
    (State.ACTIVE, "deactivate"): State.INACTIVE,
    (State.INACTIVE, "error"): State.UNCONFIGURED,
    (State.ACTIVE, "error"): State.UNCONFIGURED,
    (State.UNCONFIGURED, "shutdown"): State.FINALIZED,
    (State.INACTIVE, "shutdown"): State.FINALIZED,
    (State.ACTIVE, "shutdown"): State.FINALIZED,
}
"""After an error it is unconfigured, from where it can be brought up again."""


class InvalidTransition(SimpleRosError, RuntimeError):
    """That cannot happen in this state.

    Attributes:
        name: Whose lifecycle.
        state: Where it is.
        transition: What was to happen.
    """

    def __init__(self, name: str, state: State, transition: str) -> None:
        self.name = name
        self.state = state
        self.transition = transition
        super().__init__(f"{name} is {state.value}: it cannot {transition}")


class Lifecycle:
    """One lifecycle.

    Args:
        name: Whose, for errors and listeners.
        changed: Told name, transition, former and new state.
    """

    def __init__(
        self, name: str, changed: Callable[[str, str, State, State], None] | None = None
    ) -> None:
        self.name = name
        self.state = State.UNCONFIGURED
        self._changed = changed

    def go(self, transition: str) -> State:
        """Let a transition happen; gives the new state.

        Raises:
            InvalidTransition: It cannot, in this state.
        """
        new = _TABLE.get((self.state, transition))
        if new is None:
            raise InvalidTransition(self.name, self.state, transition)
        before, self.state = self.state, new
        if self._changed is not None:
            self._changed(self.name, transition, before, new)
        return new
