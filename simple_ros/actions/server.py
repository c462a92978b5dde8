"""The server's side of actions: carries requests to the book of goals, and runs what it says."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Coroutine
from typing import TYPE_CHECKING, Any, Generic, Self, TypeVar

from google.protobuf.message import Message

from simple_ros.actions.asking import Asking, CancelCallback, GoalCallback
from simple_ros.actions.book import CancelRefusal, GoalBook, GoalRecord
from simple_ros.actions.goal import ServerGoal, message_as
from simple_ros.actions.messages import ActionMessages, ActionNames, messages_of
from simple_ros.actions.reporting import Reports
from simple_ros.actions.states import GoalEvent, GoalState
from simple_ros.callbacks import CALLBACK_ERRORS, CallbackGuard, is_async
from simple_ros.errors import InvalidGoalTransition
from simple_ros.msg.action_msgs import CancelGoalRequest, CancelGoalResponse
from simple_ros.msg.interfaces import ActionType
from simple_ros.rpc import services_pb2 as srv

if TYPE_CHECKING:
    from simple_ros.node import NodeHandle
    from simple_ros.service_server import ServiceServer

__all__ = ["ActionServer", "Execute"]

logger = logging.getLogger(__name__)

GoalT = TypeVar("GoalT", bound=Message)
ResultT = TypeVar("ResultT", bound=Message)
FeedbackT = TypeVar("FeedbackT", bound=Message)
Execute = (
    Callable[[ServerGoal[GoalT, ResultT, FeedbackT]], ResultT | None]
    | Callable[[ServerGoal[GoalT, ResultT, FeedbackT]], Coroutine[Any, Any, ResultT | None]]
)
_WAITING_CLIENTS = 10_000
_CLOSING_S = 0.3


class ActionServer(Generic[GoalT, ResultT, FeedbackT]):
    """Executes the goals of one action. Made by `NodeHandle.advertise_action`.

    It lives until closed: the node holds it.

    Attributes:
        name: Canonical name of the action.
        type: Its messages.
        messages: What wraps them on the way.
    """

    def __init__(
        self,
        node: NodeHandle,
        name: str,
        kind: ActionType[GoalT, ResultT, FeedbackT],
        execute: Execute[GoalT, ResultT, FeedbackT],
        book: GoalBook,
        *,
        on_goal: GoalCallback[GoalT],
        on_cancel: CancelCallback,
        interrupt: bool,
    ) -> None:
        self.name = name
        self.type = kind
        self.messages: ActionMessages = messages_of(kind)
        self._node = node
        self._names = ActionNames(name)
        self._book = book
        self._execute: Any = execute
        self._interrupt = interrupt
        self._guard = CallbackGuard(f"action {name!r}")
        self._asking = Asking(self._guard, on_goal, on_cancel)
        self._reports = Reports(book)
        self._loop = asyncio.get_running_loop()
        self._active: dict[bytes, ServerGoal[GoalT, ResultT, FeedbackT]] = {}
        self._services: list[ServiceServer[Any, Any]] = []
        self._expiry: asyncio.TimerHandle | None = None
        self._closed = False

    async def open(self) -> None:
        """Offer the action (called by the node). Clients find it by send_goal, which comes last.

        Raises:
            RegistrationRefused: Another node has the action.
        """
        node, names, messages = self._node, self._names, self.messages
        try:
            await self._provide(names.cancel_goal, messages.cancel_goal, self._cancel_asked)
            await self._provide(names.get_result, messages.get_result, self._result_asked)
            await self._reports.open(node, names, messages)
            await self._provide(
                names.send_goal,
                messages.send_goal,
                self._goal_sent,
                also=self.type.classes,
                describe=self._describe,
            )
        except BaseException:
            self._closed = True
            await self._close_parts()
            raise

    async def _provide(self, name: str, kind: Any, handler: Any, **more: Any) -> None:
        server = await self._node.provide(
            name, kind, handler, max_concurrent=_WAITING_CLIENTS, **more
        )
        self._services.append(server)

    def _describe(self, info: srv.ServiceInfo) -> None:
        goal, result, feedback = (part.DESCRIPTOR.full_name for part in self.type.classes)
        info.action.goal_type = goal
        info.action.result_type = result
        info.action.feedback_type = feedback

    @property
    def goals(self) -> tuple[ServerGoal[GoalT, ResultT, FeedbackT], ...]:
        """The goals that have not ended, in the order in which they were accepted."""
        return tuple(self._active.values())

    # -- goals come ----------------------------------------------------------------------------

    async def _goal_sent(self, request: Any) -> Any:
        reason = self._book.refusal(request.goal_id) or await self._asking.refusal(request.goal)
        # Others may have come while the callback waited.
        reason = reason or self._book.refusal(request.goal_id)
        if reason or self._closed:
            return self.messages.send_goal.response(reason=reason or "the server was closed")
        record = self._book.accept(request.goal_id, time.time_ns())
        self._active[record.goal_id] = ServerGoal(self, request.goal, record)
        for other in self._book.superseded(record):
            self._request_end(self._active[other.goal_id], f"preempted by goal {record.hex}")
        self._start_next()
        answer = self.messages.send_goal.response(accepted=True)
        answer.stamp.FromNanoseconds(record.stamp_ns)
        return answer

    def _start_next(self) -> None:
        for record in self._book.start_next():
            self._begin(self._active[record.goal_id])
        self._reports.states_changed()

    def _begin(self, goal: ServerGoal[GoalT, ResultT, FeedbackT]) -> None:
        if is_async(self._execute):
            name = f"goal {goal.goal_id.hex} of {self.name}"
            goal._task = self._loop.create_task(self._execute(goal), name=name)
            goal._task.add_done_callback(lambda task: self._executed(goal, task))
        else:
            # Later, so that the client hears first that its goal was accepted.
            self._loop.call_soon(self._run_plain, goal)

    # -- goals are executed --------------------------------------------------------------------

    def _run_plain(self, goal: ServerGoal[GoalT, ResultT, FeedbackT]) -> None:
        if goal.state is GoalState.CANCELING and self._interrupt:
            self.end(goal, GoalEvent.CANCELED, None, goal._record.error)
        if not goal.is_active:
            return
        try:
            result = self._execute(goal)
        except CALLBACK_ERRORS as error:
            self._failed(goal, error)
        else:
            self._returned(goal, result)

    def _executed(
        self, goal: ServerGoal[GoalT, ResultT, FeedbackT], task: asyncio.Task[Any]
    ) -> None:
        if task.cancelled():
            if goal.state is GoalState.CANCELING:
                self.end(goal, GoalEvent.CANCELED, None, goal._record.error)
            elif goal.is_active:
                self.end(goal, GoalEvent.ABORT, None, "its execution was cancelled")
        elif (error := task.exception()) is not None:
            self._failed(goal, error)
        else:
            self._returned(goal, task.result())

    def _returned(self, goal: ServerGoal[GoalT, ResultT, FeedbackT], result: Any) -> None:
        if not goal.is_active:
            return
        if result is None:
            wanted = self.type.result.DESCRIPTOR.full_name
            self._failed(goal, TypeError(f"execute returned nothing, and no {wanted}"))
            return
        try:
            self.end(goal, GoalEvent.SUCCEED, result, "")
        except TypeError as error:
            self._failed(goal, error)

    def _failed(self, goal: ServerGoal[GoalT, ResultT, FeedbackT], error: BaseException) -> None:
        if not goal.is_active and isinstance(error, InvalidGoalTransition):
            # Ordinary for code that learns by it that the goal was ended from elsewhere.
            logger.info("action %r: %s", self.name, error)
            return
        self._guard.failed(error)
        if goal.is_active:
            goal._record.error_type = type(error).__name__
            self.end(goal, GoalEvent.ABORT, None, str(error))

    def send_feedback(self, message: Any) -> None:
        """Send feedback (called by its goal)."""
        self._reports.feedback(message)

    def end(
        self,
        goal: ServerGoal[GoalT, ResultT, FeedbackT],
        event: GoalEvent,
        result: ResultT | None,
        reason: str,
    ) -> None:
        """A goal ends (called by it)."""
        record = goal._record
        if result is not None:
            result = message_as(self.type.result, result, f"the result of {self.name!r}")
        self._book.step(record, event, self._loop.time())
        record.result = result
        record.error = reason or ("" if event is GoalEvent.SUCCEED else record.error)
        del self._active[record.goal_id]
        goal._ended.set()
        goal._cancel.set()
        self._expire_later()
        if not self._closed:
            self._start_next()

    # -- goals are canceled --------------------------------------------------------------------

    async def _cancel_asked(self, request: CancelGoalRequest) -> CancelGoalResponse:
        info = request.goal_info
        wanted, refusal = self._book.to_cancel(info.goal_id, info.stamp.ToNanoseconds())
        if not wanted:
            return CancelGoalResponse(return_code=_REFUSALS[refusal])
        canceling = [record for record in wanted if await self._may_cancel(record)]
        answer = CancelGoalResponse()
        for record in canceling:
            said = answer.goals_canceling.add(goal_id=record.goal_id)
            said.stamp.FromNanoseconds(record.stamp_ns)
        if not canceling:
            ended = all(record.state.is_terminal for record in wanted)
            answer.return_code = (
                CancelGoalResponse.ERROR_GOAL_TERMINATED
                if ended
                else CancelGoalResponse.ERROR_REJECTED
            )
        return answer

    async def _may_cancel(self, record: GoalRecord) -> bool:
        """Whether a goal is about to end, now that somebody asks for it."""
        goal = self._active.get(record.goal_id)
        if goal is None:
            return False
        allowed = goal.is_cancel_requested or await self._asking.may_cancel(goal)
        if not allowed or not goal.is_active:
            return False
        if not goal.is_cancel_requested:
            self._request_end(goal, "")
        return True

    def _request_end(self, goal: ServerGoal[GoalT, ResultT, FeedbackT], reason: str) -> None:
        was_waiting = goal.state is GoalState.ACCEPTED
        goal._record.error = reason
        self._book.step(goal._record, GoalEvent.CANCEL_GOAL, self._loop.time())
        goal._cancel.set()
        if was_waiting:
            self.end(goal, GoalEvent.CANCELED, None, reason)
        elif self._interrupt and goal._task is not None:
            goal._task.cancel()
        self._reports.states_changed()

    # -- what clients are told -----------------------------------------------------------------

    async def _result_asked(self, request: Any) -> Any:
        record = self._book.find(request.goal_id)
        if record is None:
            return self.messages.get_result.response(status=GoalState.UNKNOWN)
        goal = self._active.get(record.goal_id)
        if goal is not None:
            await goal._ended.wait()
        record.fetched = True
        return self.messages.get_result.response(
            status=record.state,
            result=record.result,
            error_type=record.error_type,
            error=record.error,
            feedback_count=record.feedback_count,
        )

    def _expire_later(self) -> None:
        if self._expiry is None and not self._closed:
            self._expire()

    def _expire(self) -> None:
        due = self._book.expire(self._loop.time())
        self._expiry = None if due is None else self._loop.call_at(due, self._expire)

    # -- the end -------------------------------------------------------------------------------

    async def close(self) -> None:
        """Stop: goals that have not ended are aborted, their clients told, further ones refused."""
        if not self._closed:
            await self.finish(asyncio.current_task())
            await self._close_parts()
            self._node.action_handles.discard(self)

    async def finish(self, caller: asyncio.Task[Any] | None) -> None:
        """Abort all goals and let their clients hear of it (called by the node when it closes)."""
        tasks = self._end_all(caller)
        if tasks:
            await asyncio.wait(tasks, timeout=_CLOSING_S)
        # The answers leave in the tasks of the calls that wait for them.
        await asyncio.sleep(0)
        await asyncio.sleep(0)

    def abandon(self, caller: asyncio.Task[Any] | None = None) -> None:
        """End at once (called by the node); cancels no task that is the caller."""
        self._end_all(caller)

    def _end_all(self, caller: asyncio.Task[Any] | None) -> list[asyncio.Task[Any]]:
        """Abort every goal; return the tasks that have been cancelled."""
        if self._closed:
            return []
        self._closed = True
        goals = self.goals
        for goal in goals:
            if goal.state is GoalState.ACCEPTED:
                self._book.step(goal._record, GoalEvent.CANCEL_GOAL, self._loop.time())
            self.end(goal, GoalEvent.ABORT, None, "the action server was closed")
        self._reports.end()
        if self._expiry is not None:
            self._expiry.cancel()
        tasks = [goal._task for goal in goals if goal._task not in (None, caller)]
        cancelled = [task for task in tasks if task is not None]
        for task in cancelled:
            task.cancel()
        return cancelled

    async def _close_parts(self) -> None:
        for service in reversed(self._services):
            await service.close()
        await self._reports.close()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    def __repr__(self) -> str:
        state = "closed" if self._closed else f"{len(self._active)} goals"
        return f"<ActionServer {self.name} [{self.type.name}] {state}>"


_REFUSALS: dict[CancelRefusal, CancelGoalResponse.ReturnCode.ValueType] = {
    "": CancelGoalResponse.ERROR_NONE,
    "unknown": CancelGoalResponse.ERROR_UNKNOWN_GOAL_ID,
    "terminated": CancelGoalResponse.ERROR_GOAL_TERMINATED,
}
