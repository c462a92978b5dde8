"""A goal as the code that executes it sees it."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any, Generic, TypeVar
from uuid import UUID

from google.protobuf.message import Message

from simple_ros.actions.book import GoalRecord
from simple_ros.actions.states import GoalEvent, GoalState
from simple_ros.errors import InvalidGoalTransition

if TYPE_CHECKING:
    from simple_ros.actions.server import ActionServer

__all__ = ["ServerGoal", "message_as"]

GoalT = TypeVar("GoalT", bound=Message)
ResultT = TypeVar("ResultT", bound=Message)
FeedbackT = TypeVar("FeedbackT", bound=Message)


class ServerGoal(Generic[GoalT, ResultT, FeedbackT]):
    """A goal that an action server has accepted. Given to ``execute`` and ``on_cancel``.

    Attributes:
        goal: What the client sent.
        goal_id: Its id.
    """

    def __init__(
        self,
        server: ActionServer[GoalT, ResultT, FeedbackT],
        goal: GoalT,
        record: GoalRecord,
    ) -> None:
        self.goal = goal
        self.goal_id = UUID(bytes=record.goal_id)
        self._server = server
        self._record = record
        self._ended = asyncio.Event()
        self._cancel = asyncio.Event()
        self._task: asyncio.Task[Any] | None = None

    @property
    def state(self) -> GoalState:
        """How far it is."""
        return self._record.state

    @property
    def is_active(self) -> bool:
        """Whether it has not ended."""
        return not self._record.state.is_terminal

    @property
    def is_cancel_requested(self) -> bool:
        """Whether it is to end, because a client or the policy of the server wants it."""
        return self._cancel.is_set()

    async def wait_cancel_requested(self) -> None:
        """Return when it is to end, or has."""
        await self._cancel.wait()

    def publish_feedback(self, feedback: FeedbackT) -> None:
        """Tell the clients how it goes.

        Raises:
            TypeError: The message is of another type than the action's feedback.
            InvalidGoalTransition: The goal has ended.
            HandleClosed: The action server is closed.
        """
        server, record = self._server, self._record
        if not self.is_active:
            raise InvalidGoalTransition(record.hex, record.state.name, "publish_feedback")
        message = server.messages.feedback(
            goal_id=record.goal_id,
            feedback=message_as(server.type.feedback, feedback, f"feedback of {server.name!r}"),
            number=record.feedback_count + 1,
        )
        server.send_feedback(message)
        record.feedback_count += 1

    def abort(self, result: ResultT | None = None, reason: str = "") -> None:
        """End the goal: it could not be reached. What ``execute`` returns then does not matter.

        Args:
            result: What there is of a result.
            reason: Shown to the client.

        Raises:
            TypeError: The result is of another type than the action's.
            InvalidGoalTransition: The goal has ended already.
        """
        self._server.end(self, GoalEvent.ABORT, result, reason)

    def canceled(self, result: ResultT | None = None, reason: str = "") -> None:
        """End the goal, as was asked. What ``execute`` returns then does not matter.

        Args:
            result: What there is of a result.
            reason: Shown to the client.

        Raises:
            TypeError: The result is of another type than the action's.
            InvalidGoalTransition: The goal has ended already, or nobody wanted it canceled.
        """
        self._server.end(self, GoalEvent.CANCELED, result, reason)

    def __repr__(self) -> str:
        return f"<ServerGoal {self._server.name} {self.goal_id.hex} {self.state.name}>"


def message_as(wanted: type[Any], message: Any, what: str) -> Any:
    """A message as an instance of a class, which may be another class of the same type.

    Raises:
        TypeError: It is of another type.
    """
    if isinstance(message, wanted):
        return message
    descriptor = getattr(message, "DESCRIPTOR", None)
    given = getattr(descriptor, "full_name", type(message).__name__)
    if given != wanted.DESCRIPTOR.full_name:
        raise TypeError(f"{what} is a {wanted.DESCRIPTOR.full_name}, not {given}")
    return wanted.FromString(message.SerializeToString())
