"""A goal as the program that sent it sees it."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar
from uuid import UUID

from google.protobuf.message import Message

from simple_ros.actions.states import GoalState, advanced
from simple_ros.callbacks import is_async
from simple_ros.errors import GoalAborted, GoalCanceled

if TYPE_CHECKING:
    from simple_ros.actions.client import ActionClient

__all__ = ["ClientGoal", "FeedbackCallback", "GoalOutcome"]

ResultT = TypeVar("ResultT", bound=Message)
FeedbackT = TypeVar("FeedbackT", bound=Message)
FeedbackCallback = Callable[[FeedbackT], object]

_KEPT_FEEDBACK = 100
_LAST_FEEDBACK_S = 0.3


@dataclass(frozen=True, slots=True)
class GoalOutcome(Generic[ResultT]):
    """How a goal ended.

    Attributes:
        state: SUCCEEDED, CANCELED or ABORTED.
        result: The result; an empty one if the server gave none.
        error_type: Class of the exception that ended it; empty if none did.
        error: Why it did not succeed, if the server said so.
    """

    state: GoalState
    result: ResultT
    error_type: str
    error: str


class ClientGoal(Generic[ResultT, FeedbackT]):
    """A goal at an action server. Made by `ActionClient.send_goal` and `ActionClient.goal`.

    ``async for feedback in goal`` gives the feedback from then on, and ends when the goal does.

    Attributes:
        goal_id: Its id; `ActionClient.goal` takes it, also in another process later.
    """

    def __init__(
        self,
        client: ActionClient[Any, ResultT, FeedbackT],
        goal_id: UUID,
        feedback: FeedbackCallback[FeedbackT] | None,
    ) -> None:
        self.goal_id = goal_id
        self._client = client
        self._state = GoalState.UNKNOWN
        self._outcome: GoalOutcome[ResultT] | None = None
        self._callbacks: list[FeedbackCallback[FeedbackT]] = []
        self._kept: deque[FeedbackT] = deque(maxlen=_KEPT_FEEDBACK)
        self._arrived = asyncio.Event()
        self._seen = 0
        self._iterators = 0
        self._early: list[tuple[FeedbackT, int]] | None = None
        if feedback is not None:
            self.take_feedback_by(feedback)

    @property
    def status(self) -> GoalState:
        """How far the goal is, as last heard."""
        return self._state

    async def result(self, timeout: float | None = None) -> ResultT:
        """The result, once the goal has succeeded.

        Args:
            timeout: Seconds to wait; None for as long as the server lives. The goal itself goes on.

        Raises:
            GoalAborted: The server gave it up; the error has what there is of a result.
            GoalCanceled: It was canceled; the error has what there is of a result.
            TimeoutError: It has not ended in time.
            ActionServerLost: The server ended before the goal did.
            UnknownGoal: The server knows no such goal.
        """
        outcome = await self.outcome(timeout)
        name, goal_id = self._client.name, self.goal_id.hex
        match outcome.state:
            case GoalState.SUCCEEDED:
                return outcome.result
            case GoalState.CANCELED:
                raise GoalCanceled(name, goal_id, outcome.result, outcome.error)
            case _:
                raise GoalAborted(name, goal_id, outcome.result, outcome.error_type, outcome.error)

    async def outcome(self, timeout: float | None = None) -> GoalOutcome[ResultT]:
        """How the goal ended, once it has; as `result`, but no end of it is an error.

        Args:
            timeout: Seconds to wait; None for as long as the server lives.

        Raises:
            TimeoutError: It has not ended in time.
            ActionServerLost: The server ended before the goal did.
            UnknownGoal: The server knows no such goal.
        """
        if self._outcome is None:
            try:
                async with asyncio.timeout(timeout) as limit:
                    self._outcome = await self._fetched()
            except TimeoutError:
                if not limit.expired():
                    raise
                raise TimeoutError(
                    f"goal {self.goal_id.hex} of action {self._client.name!r} has not ended within "
                    f"{timeout:g} s; it goes on"
                ) from None
        return self._outcome

    async def _fetched(self) -> GoalOutcome[ResultT]:
        if self._takes_feedback:
            await self._client.listen()
        answer = await self._client.fetch(self.goal_id)
        if self._takes_feedback and self._seen < answer.feedback_count:
            await self._rest_of_feedback(answer.feedback_count)
        self.heard(GoalState(answer.status))
        return GoalOutcome(GoalState(answer.status), answer.result, answer.error_type, answer.error)

    async def _rest_of_feedback(self, count: int) -> None:
        """Let feedback that is still on its way come first; what is lost is not waited for long."""
        loop = asyncio.get_running_loop()
        end = loop.time() + _LAST_FEEDBACK_S
        while self._seen < count and loop.time() < end:
            self._arrived.clear()
            try:
                async with asyncio.timeout(end - loop.time()):
                    await self._arrived.wait()
            except TimeoutError:
                return

    async def cancel(self) -> bool:
        """Ask the server to end the goal; `result` tells when it has.

        Returns:
            True if the goal is about to end, False if it had ended already.

        Raises:
            CancelRejected: The server refuses.
            UnknownGoal: The server knows no such goal.
            ServiceUnavailable: There is no server.
        """
        canceling = await self._client.cancel_goal(self.goal_id)
        if canceling:
            self.heard(GoalState.CANCELING)
        return canceling

    async def __aiter__(self) -> AsyncIterator[FeedbackT]:
        """Feedback until the goal has ended, in whichever way.

        Raises:
            ActionServerLost: The server ended before the goal did.
            UnknownGoal: The server knows no such goal.
        """
        self._iterators += 1
        ending = asyncio.ensure_future(self.outcome())
        ending.add_done_callback(lambda _: self._arrived.set())
        try:
            while True:
                while self._kept:
                    yield self._kept.popleft()
                if ending.done():
                    ending.result()
                    return
                self._arrived.clear()
                await self._arrived.wait()
        finally:
            self._iterators -= 1
            ending.cancel()
            await asyncio.wait((ending,))

    # -- what the client hears -----------------------------------------------------------------

    @property
    def _takes_feedback(self) -> bool:
        return bool(self._callbacks or self._iterators)

    def take_feedback_by(self, callback: FeedbackCallback[FeedbackT]) -> None:
        """Call with feedback from now on (called by the client).

        Raises:
            TypeError: It is a coroutine function.
        """
        if is_async(callback):
            raise TypeError(
                "feedback is taken by a plain function, not by a coroutine function; "
                "use 'async for feedback in goal' to wait in between"
            )
        self._callbacks.append(callback)

    def sent(self) -> None:
        """The goal goes out (called by the client): feedback may be here before its acceptance is."""
        self._early = []

    def accepted(self) -> None:
        """The server has taken it (called by the client); feedback comes after who sent it knows."""
        self.heard(GoalState.ACCEPTED)
        asyncio.get_running_loop().call_soon(self._release)

    def _release(self) -> None:
        early, self._early = self._early or (), None
        for feedback, number in early:
            self.feedback_came(feedback, number)

    def feedback_came(self, feedback: FeedbackT, number: int) -> None:
        """A message has arrived (called by the client)."""
        if self._early is not None:
            self._early.append((feedback, number))
            return
        self.heard(GoalState.EXECUTING)
        self._seen = max(self._seen, number)
        for callback in self._callbacks:
            self._client.guard.call(callback, feedback)
        if not self._callbacks or self._iterators:
            self._kept.append(feedback)
        self._arrived.set()

    def heard(self, state: GoalState) -> None:
        """The server says how far the goal is (called by the client)."""
        before, self._state = self._state, advanced(self._state, state)
        if self._state.is_terminal and not before.is_terminal:
            self._client.goal_ended(self.goal_id)

    def __repr__(self) -> str:
        return f"<ClientGoal {self._client.name} {self.goal_id.hex} {self._state.name}>"
