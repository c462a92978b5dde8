"""The states of a goal and what leads from one to the next: the table of ROS 2, and nothing else."""

from __future__ import annotations

from enum import Enum, IntEnum

from simple_ros.errors import InvalidGoalTransition

__all__ = ["GoalEvent", "GoalState", "advanced", "next_state"]


class GoalState(IntEnum):
    """How far a goal is, with the numbers of ``action_msgs.GoalStatus``."""

    UNKNOWN = 0
    """Nothing has been heard of it."""
    ACCEPTED = 1
    """It waits for its turn."""
    EXECUTING = 2
    CANCELING = 3
    """It is to end, and has not yet."""
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6
    """The server gave up."""

    @property
    def is_terminal(self) -> bool:
        """Whether the goal has ended."""
        return self >= GoalState.SUCCEEDED

    def __str__(self) -> str:
        return self.name


class GoalEvent(Enum):
    """What happens to a goal."""

    EXECUTE = "execute"
    CANCEL_GOAL = "cancel_goal"
    SUCCEED = "succeed"
    ABORT = "abort"
    CANCELED = "canceled"


_TRANSITIONS = {
    (GoalState.ACCEPTED, GoalEvent.EXECUTE): GoalState.EXECUTING,
    (GoalState.ACCEPTED, GoalEvent.CANCEL_GOAL): GoalState.CANCELING,
    (GoalState.EXECUTING, GoalEvent.CANCEL_GOAL): GoalState.CANCELING,
    (GoalState.EXECUTING, GoalEvent.SUCCEED): GoalState.SUCCEEDED,
    (GoalState.EXECUTING, GoalEvent.ABORT): GoalState.ABORTED,
    (GoalState.CANCELING, GoalEvent.SUCCEED): GoalState.SUCCEEDED,
    (GoalState.CANCELING, GoalEvent.ABORT): GoalState.ABORTED,
    (GoalState.CANCELING, GoalEvent.CANCELED): GoalState.CANCELED,
}


def next_state(state: GoalState, event: GoalEvent, goal_id: str = "") -> GoalState:
    """The state after an event.

    Args:
        state: The state before.
        event: What happens.
        goal_id: Of the goal, for the error.

    Raises:
        InvalidGoalTransition: That cannot happen in this state.
    """
    following = _TRANSITIONS.get((state, event))
    if following is None:
        raise InvalidGoalTransition(goal_id, state.name, event.value)
    return following


def advanced(known: GoalState, heard: GoalState) -> GoalState:
    """What is known of a goal after hearing of it; what was sent earlier may be heard later."""
    return known if known.is_terminal else max(known, heard)
