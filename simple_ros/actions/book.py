"""What an action server keeps of its goals, and which of them may run: values in, values out.

Goals under way are bounded in number: further ones are refused. Goals that have ended are kept for
``result_timeout_s``, so that their results can be fetched later, by a client that was restarted, say. Of
more than ``max_results`` the oldest go, those first whose result was fetched.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal, get_args

from simple_ros.actions.states import GoalEvent, GoalState, next_state
from simple_ros.errors import ConfigError

__all__ = ["CancelRefusal", "GoalBook", "GoalPolicy", "GoalRecord"]

GoalPolicy = Literal["parallel", "preempt", "queue", "reject"]
CancelRefusal = Literal["", "unknown", "terminated"]

_ID_BYTES = 16
_NONE = (b"", bytes(_ID_BYTES))


@dataclass(slots=True, eq=False)
class GoalRecord:
    """One goal.

    Attributes:
        goal_id: 16 bytes.
        stamp_ns: When it was accepted, ns since 1970.
        state: How far it is.
        result: The result message; None if there is none.
        error_type: Class of the exception that ended it.
        error: Why it did not succeed, if anybody said so.
        feedback_count: Feedback messages so far.
        fetched: Whether somebody has fetched the result.
        keep_until: When its result may be forgotten, on the caller's clock.
    """

    goal_id: bytes
    stamp_ns: int
    state: GoalState = GoalState.ACCEPTED
    result: Any = None
    error_type: str = ""
    error: str = ""
    feedback_count: int = 0
    fetched: bool = False
    keep_until: float = math.inf

    @property
    def hex(self) -> str:
        """The id as people read it."""
        return self.goal_id.hex()


class GoalBook:
    """The goals of one action server.

    Args:
        policy: What happens when a goal comes while another one is under way: ``parallel`` runs both,
            ``queue`` lets it wait, ``reject`` refuses it, ``preempt`` cancels the other one first.
        result_timeout_s: How long results are kept.
        max_goals: How many goals may be under way or wait.
        max_results: How many results are kept.

    Raises:
        ConfigError: There is no such policy, or a number is out of range.
    """

    def __init__(
        self,
        policy: GoalPolicy,
        *,
        result_timeout_s: float = 900.0,
        max_goals: int = 1000,
        max_results: int = 1000,
    ) -> None:
        if policy not in get_args(GoalPolicy):
            known = ", ".join(map(repr, get_args(GoalPolicy)))
            raise ConfigError(f"an action's policy is one of {known}, not {policy!r}")
        if not result_timeout_s >= 0:
            raise ConfigError(f"result_timeout_s must not be negative, as is {result_timeout_s!r}")
        if max_goals < 1 or max_results < 1:
            raise ConfigError("max_goals and max_results are at least 1")
        self._policy = policy
        self._result_timeout_s = result_timeout_s
        self._max_goals = max_goals
        self._max_results = max_results
        self._active: dict[bytes, GoalRecord] = {}
        self._ended: dict[bytes, GoalRecord] = {}

    @property
    def active(self) -> tuple[GoalRecord, ...]:
        """Goals that have not ended, in the order in which they were accepted."""
        return tuple(self._active.values())

    def last_ended(self, count: int) -> Iterable[GoalRecord]:
        """The goals that ended last, the oldest first."""
        return list(self._ended.values())[-count:]

    def find(self, goal_id: bytes) -> GoalRecord | None:
        """A goal that is under way or whose result is kept."""
        return self._active.get(goal_id) or self._ended.get(goal_id)

    # -- goals come ----------------------------------------------------------------------------

    def refusal(self, goal_id: bytes) -> str:
        """Why a goal cannot be accepted now; empty if it can."""
        if len(goal_id) != _ID_BYTES or goal_id in _NONE:
            return f"a goal's id is {_ID_BYTES} bytes that are not all zero"
        if self.find(goal_id) is not None:
            return f"there is a goal {goal_id.hex()} already"
        if self._policy == "reject" and self._active:
            return (
                f"goal {next(iter(self._active)).hex()} is under way, and one is all there may be"
            )
        if len(self._active) >= self._max_goals:
            return f"{self._max_goals} goals are under way, and more there may not be"
        return ""

    def accept(self, goal_id: bytes, stamp_ns: int) -> GoalRecord:
        """Take a goal for which there is no `refusal`."""
        record = self._active[goal_id] = GoalRecord(goal_id, stamp_ns)
        return record

    def superseded(self, newcomer: GoalRecord) -> list[GoalRecord]:
        """Goals that have to make way for a new one."""
        if self._policy != "preempt":
            return []
        others = (record for record in self.active if record is not newcomer)
        return [record for record in others if record.state is not GoalState.CANCELING]

    def start_next(self) -> list[GoalRecord]:
        """Goals whose turn it is: they are executing from now on."""
        waiting = [record for record in self.active if record.state is GoalState.ACCEPTED]
        if self._policy != "parallel":
            waiting = [] if len(waiting) < len(self._active) else waiting[:1]
        for record in waiting:
            record.state = next_state(record.state, GoalEvent.EXECUTE, record.hex)
        return waiting

    # -- goals end -----------------------------------------------------------------------------

    def to_cancel(self, goal_id: bytes, stamp_ns: int) -> tuple[list[GoalRecord], CancelRefusal]:
        """Which goals a cancel request means.

        Args:
            goal_id: A goal, or none.
            stamp_ns: With a time, all goals accepted until then; 0 for no time.

        Returns:
            Goals that have not ended; and if there are none, what is wrong with the id.
        """
        named = goal_id not in _NONE
        if not named and not stamp_ns:
            return list(self.active), ""
        found = [record for record in self.active if record.stamp_ns <= stamp_ns]
        if not named:
            return found, ""
        record = self._active.get(goal_id)
        if record is not None and record not in found:
            found.append(record)
        if found or record is not None:
            return found, ""
        return [], "terminated" if goal_id in self._ended else "unknown"

    def step(self, record: GoalRecord, event: GoalEvent, now: float) -> None:
        """Something happens to a goal at a time.

        Raises:
            InvalidGoalTransition: It cannot happen in the state the goal is in.
        """
        record.state = next_state(record.state, event, record.hex)
        if record.state.is_terminal:
            del self._active[record.goal_id]
            record.keep_until = now + self._result_timeout_s
            self._ended[record.goal_id] = record
            if len(self._ended) > self._max_results:
                self._forget_one()

    def _forget_one(self) -> None:
        fetched = (goal_id for goal_id, record in self._ended.items() if record.fetched)
        del self._ended[next(fetched, next(iter(self._ended)))]

    def expire(self, now: float) -> float | None:
        """Forget results whose time is over; return when the next one's is."""
        for goal_id, record in list(self._ended.items()):
            if record.keep_until > now:
                return record.keep_until
            del self._ended[goal_id]
        return None
