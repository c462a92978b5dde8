"""The states of a goal: the table of ROS 2, and nothing else."""

from __future__ import annotations

import itertools

import pytest

from simple_ros.actions.states import GoalEvent, GoalState, advanced, next_state
from simple_ros.errors import InvalidGoalTransition
from simple_ros.msg.action_msgs import GoalStatus

ROS_2 = {
    ("ACCEPTED", "execute"): "EXECUTING",
    ("ACCEPTED", "cancel_goal"): "CANCELING",
    ("EXECUTING", "cancel_goal"): "CANCELING",
    ("EXECUTING", "succeed"): "SUCCEEDED",
    ("EXECUTING", "abort"): "ABORTED",
    ("CANCELING", "canceled"): "CANCELED",
    ("CANCELING", "succeed"): "SUCCEEDED",
    ("CANCELING", "abort"): "ABORTED",
}


@pytest.mark.parametrize(("state", "event"), list(itertools.product(GoalState, GoalEvent)))
def test_every_event_in_every_state(state: GoalState, event: GoalEvent) -> None:
    expected = ROS_2.get((state.name, event.value))
    if expected is not None:
        assert next_state(state, event) is GoalState[expected]
        return
    with pytest.raises(InvalidGoalTransition) as caught:
        next_state(state, event, "ab12")
    error = caught.value
    assert (error.goal_id, error.state, error.event) == ("ab12", state.name, event.value)
    assert str(error) == f"goal ab12 is {state.name}: {event.value!r} cannot happen to it"


def test_the_numbers_are_those_of_the_message() -> None:
    for state in GoalState:
        assert GoalStatus.Status.Name(state.value) == f"STATUS_{state.name}"
    assert len(GoalStatus.Status.values()) == len(GoalState)


def test_what_was_sent_earlier_may_be_heard_later() -> None:
    assert advanced(GoalState.UNKNOWN, GoalState.ACCEPTED) is GoalState.ACCEPTED
    assert advanced(GoalState.CANCELING, GoalState.EXECUTING) is GoalState.CANCELING
    assert advanced(GoalState.SUCCEEDED, GoalState.CANCELING) is GoalState.SUCCEEDED
    assert advanced(GoalState.CANCELED, GoalState.ABORTED) is GoalState.CANCELED
