"""Actions of the blocking face."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Iterator
from typing import Any, Generic, Self, TypeVar
from uuid import UUID

from google.protobuf.message import Message

from simple_ros.actions.client import ActionClient as AsyncActionClient
from simple_ros.actions.client_goal import ClientGoal as AsyncClientGoal
from simple_ros.actions.client_goal import FeedbackCallback, GoalOutcome
from simple_ros.actions.goal import ServerGoal as AsyncServerGoal
from simple_ros.actions.server import ActionServer as AsyncActionServer
from simple_ros.actions.states import GoalState
from simple_ros.blocking.service import SpinningHandler
from simple_ros.executor import Executor
from simple_ros.msg.interfaces import ActionType
from simple_ros.net.loop import BackgroundLoop

__all__ = ["ActionClient", "ActionServer", "ClientGoal", "ServerGoal"]

GoalT = TypeVar("GoalT", bound=Message)
ResultT = TypeVar("ResultT", bound=Message)
FeedbackT = TypeVar("FeedbackT", bound=Message)


class ServerGoal(Generic[GoalT, ResultT, FeedbackT]):
    """A goal that an action server has accepted. Given to ``execute`` and ``on_cancel``."""

    def __init__(
        self, loop: BackgroundLoop, goal: AsyncServerGoal[GoalT, ResultT, FeedbackT]
    ) -> None:
        self._loop = loop
        self._goal = goal

    @property
    def goal(self) -> GoalT:
        """What the client sent."""
        return self._goal.goal

    @property
    def goal_id(self) -> UUID:
        """Its id."""
        return self._goal.goal_id

    @property
    def state(self) -> GoalState:
        """How far it is."""
        return self._goal.state

    @property
    def is_active(self) -> bool:
        """Whether it has not ended."""
        return self._goal.is_active

    @property
    def is_cancel_requested(self) -> bool:
        """Whether it is to end: ``execute`` looks at this from time to time."""
        return self._goal.is_cancel_requested

    def wait_cancel_requested(self, timeout: float | None = None) -> bool:
        """Wait until it is to end, or has; a sleep that a cancel cuts short.

        Args:
            timeout: Seconds; None for as long as it takes.

        Returns:
            Whether it is.
        """
        try:
            self._loop.run(_within(self._goal.wait_cancel_requested(), timeout))
        except TimeoutError:
            return self.is_cancel_requested
        return True

    def publish_feedback(self, feedback: FeedbackT) -> None:
        """Tell the clients how it goes; see `simple_ros.aio.ServerGoal.publish_feedback`."""
        self._loop.run(_called(self._goal.publish_feedback, feedback))

    def abort(self, result: ResultT | None = None, reason: str = "") -> None:
        """End the goal: it could not be reached; see `simple_ros.aio.ServerGoal.abort`."""
        self._loop.run(_called(self._goal.abort, result, reason))

    def canceled(self, result: ResultT | None = None, reason: str = "") -> None:
        """End the goal, as was asked; see `simple_ros.aio.ServerGoal.canceled`."""
        self._loop.run(_called(self._goal.canceled, result, reason))

    def __repr__(self) -> str:
        return repr(self._goal)


class ActionServer(Generic[GoalT, ResultT, FeedbackT]):
    """Executes the goals of one action in threads that spin. Made by `NodeHandle.advertise_action`."""

    def __init__(
        self,
        loop: BackgroundLoop,
        server: AsyncActionServer[GoalT, ResultT, FeedbackT],
        handlers: tuple[SpinningHandler, ...],
    ) -> None:
        self._loop = loop
        self._server = server
        self._handlers = handlers

    @property
    def name(self) -> str:
        """Canonical name of the action."""
        return self._server.name

    @property
    def type(self) -> ActionType[GoalT, ResultT, FeedbackT]:
        """Its messages."""
        return self._server.type

    @property
    def goals(self) -> tuple[ServerGoal[GoalT, ResultT, FeedbackT], ...]:
        """The goals that have not ended, in the order in which they were accepted."""

        async def found() -> tuple[AsyncServerGoal[GoalT, ResultT, FeedbackT], ...]:
            return self._server.goals

        return tuple(ServerGoal(self._loop, goal) for goal in self._loop.run(found()))

    def close(self) -> None:
        """Stop: goals that have not ended are aborted, their clients told, further ones refused."""
        self._loop.run(self._server.close())
        for handler in self._handlers:
            handler.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return repr(self._server)


class ClientGoal(Generic[ResultT, FeedbackT]):
    """A goal at an action server. Made by `ActionClient.send_goal` and `ActionClient.goal`.

    ``for feedback in goal`` gives the feedback from then on, and ends when the goal does.
    """

    def __init__(
        self,
        loop: BackgroundLoop,
        goal: AsyncClientGoal[ResultT, FeedbackT],
        check: Callable[[], None],
    ) -> None:
        self._loop = loop
        self._goal = goal
        self._check = check

    @property
    def goal_id(self) -> UUID:
        """Its id; `ActionClient.goal` takes it, also in another process later."""
        return self._goal.goal_id

    @property
    def status(self) -> GoalState:
        """How far the goal is, as last heard."""
        return self._goal.status

    def result(self, timeout: float | None = None) -> ResultT:
        """The result, once the goal has succeeded; see `simple_ros.aio.ClientGoal.result`.

        Raises:
            GoalAborted: The server gave it up.
            GoalCanceled: It was canceled.
            TimeoutError: It has not ended within ``timeout`` seconds.
            ActionServerLost: The server ended before the goal did.
            UnknownGoal: The server knows no such goal.
            RuntimeError: It would wait for itself; see `ActionClient.send_goal`.
        """
        self._check()
        return self._loop.run(self._goal.result(timeout))

    def outcome(self, timeout: float | None = None) -> GoalOutcome[ResultT]:
        """How the goal ended, once it has; see `simple_ros.aio.ClientGoal.outcome`."""
        self._check()
        return self._loop.run(self._goal.outcome(timeout))

    def cancel(self) -> bool:
        """Ask the server to end the goal; see `simple_ros.aio.ClientGoal.cancel`."""
        return self._loop.run(self._goal.cancel())

    def __iter__(self) -> Iterator[FeedbackT]:
        """Feedback until the goal has ended, in whichever way."""
        self._check()
        found = aiter(self._goal)
        end: Any = object()

        async def following() -> Any:
            return await anext(found, end)

        async def leave() -> None:
            await found.aclose()  # type: ignore[attr-defined]

        try:
            while (feedback := self._loop.run(following())) is not end:
                yield feedback
        finally:
            self._loop.run(leave())

    def __repr__(self) -> str:
        return repr(self._goal)


class ActionClient(Generic[GoalT, ResultT, FeedbackT]):
    """Sends goals to one action. Made by `NodeHandle.action_client`. May be used from any thread."""

    def __init__(
        self,
        loop: BackgroundLoop,
        executor: Executor,
        client: AsyncActionClient[GoalT, ResultT, FeedbackT],
        is_own: Callable[[str], bool],
    ) -> None:
        self._loop = loop
        self._executor = executor
        self._client = client
        self._is_own = is_own

    @property
    def name(self) -> str:
        """Canonical name of the action."""
        return self._client.name

    @property
    def type(self) -> ActionType[GoalT, ResultT, FeedbackT]:
        """Its messages."""
        return self._client.type

    def send_goal(
        self,
        goal: GoalT,
        *,
        feedback: FeedbackCallback[FeedbackT] | None = None,
        timeout: float | None = None,
    ) -> ClientGoal[ResultT, FeedbackT]:
        """Send a goal; returns when the server has accepted it; see `simple_ros.aio.ActionClient.send_goal`.

        Args:
            goal: What is to be reached.
            feedback: Called with each feedback message in a thread that spins.
            timeout: Seconds to wait for the server's answer.

        Raises:
            GoalRejected: The server refuses it.
            ServiceUnavailable: There is no server.
            ServiceTimeout: No answer in time.
            RuntimeError: It would wait for itself: the only thread that spins asks an action of its own
                process. Use ``spin(threads=2)`` and a callback group.
        """
        self._check()
        sent = self._client.send_goal(goal, feedback=self._handed(feedback), timeout=timeout)
        return ClientGoal(self._loop, self._loop.run(sent), self._check)

    def goal(
        self,
        goal_id: UUID | bytes | str,
        *,
        feedback: FeedbackCallback[FeedbackT] | None = None,
    ) -> ClientGoal[ResultT, FeedbackT]:
        """A goal that was sent before, by whichever client; see `simple_ros.aio.ActionClient.goal`."""
        found = self._loop.run(
            _called(lambda: self._client.goal(goal_id, feedback=self._handed(feedback)))
        )
        return ClientGoal(self._loop, found, self._check)

    def cancel_all(self, before: float | None = None) -> list[UUID]:
        """Cancel every goal of the action, whoever sent it; see `simple_ros.aio.ActionClient.cancel_all`."""
        return self._loop.run(self._client.cancel_all(before))

    def wait_for_server(self, timeout: float | None = None) -> None:
        """Return when there is a server and it can be called.

        Raises:
            TimeoutError: Not within ``timeout`` seconds.
        """
        self._loop.run(self._client.wait_for_server(timeout))

    def _handed(
        self, feedback: FeedbackCallback[FeedbackT] | None
    ) -> FeedbackCallback[FeedbackT] | None:
        """The same callback, called in a thread that spins."""
        if feedback is None:
            return None
        return lambda message: self._executor.call_soon(lambda: feedback(message))

    def _check(self) -> None:
        if self._is_own(self.name) and self._executor.is_only_thread(threading.get_ident()):
            raise RuntimeError(
                f"action {self.name!r} is executed by this process, and the only thread that could do "
                "it is the one that waits; use spin(threads=2) and another callback group"
            )

    def close(self) -> None:
        """Send no more and hear no more; goals under way go on at the server."""
        self._loop.run(self._client.close())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return repr(self._client)


async def _called(function: Callable[..., Any], *arguments: Any) -> Any:
    return function(*arguments)


async def _within(waiting: Any, timeout: float | None) -> None:
    async with asyncio.timeout(timeout):
        await waiting
