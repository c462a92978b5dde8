"""What is printed of a goal: text for people, or one JSON document a line."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any
from uuid import UUID

from simple_ros.cli.message_text import message_json, yaml_text
from simple_ros.cli.text import json_line, say

if TYPE_CHECKING:
    from simple_ros.actions.client_goal import GoalOutcome

__all__ = ["CANCELED", "ENDED_BADLY", "Display"]

ENDED_BADLY = 1
CANCELED = 130


class Display:
    """Prints what happens to one goal."""

    def __init__(self, *, json: bool) -> None:
        self._json = json

    def accepted(self, goal_id: UUID) -> None:
        """The server has taken it."""
        self._say(f"Goal {goal_id.hex} accepted", {"event": "accepted", "goal_id": goal_id.hex})

    def feedback(self, message: Any) -> None:
        """Feedback has come."""
        if self._json:
            say(json_line({"event": "feedback", "feedback": message_json(message)}))
        else:
            say(_titled("Feedback:", message))

    def canceling(self, reason: str) -> None:
        """It is about to end."""
        self._say(f"Canceling the goal: {reason}", {"event": "canceling", "reason": reason})

    def ended(self, outcome: GoalOutcome[Any]) -> int:
        """It has ended; returns the exit code."""
        from simple_ros.actions.states import GoalState

        why = ": ".join(part for part in (outcome.error_type, outcome.error) if part)
        if self._json:
            facts = {"status": outcome.state.name, "result": message_json(outcome.result)}
            facts |= {"error_type": outcome.error_type, "error": outcome.error}
            say(json_line({"event": "ended"} | facts))
        else:
            if outcome.state is GoalState.SUCCEEDED or outcome.result.ByteSize():
                say(_titled("Result:", outcome.result))
            say(f"Goal {outcome.state.name.lower()}" + (f": {why}" if why else ""))
        codes = {GoalState.SUCCEEDED: 0, GoalState.CANCELED: CANCELED}
        return codes.get(outcome.state, ENDED_BADLY)

    def _say(self, text: str, facts: dict[str, Any]) -> None:
        say(json_line(facts) if self._json else text)


def _titled(title: str, message: Any) -> str:
    return f"{title}\n{textwrap.indent(yaml_text(message), '  ')}"
