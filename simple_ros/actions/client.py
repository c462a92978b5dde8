"""The client's side of actions."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from typing import TYPE_CHECKING, Any, Generic, Self, TypeVar
from uuid import UUID, uuid4

from google.protobuf.message import Message

from simple_ros.actions.client_goal import ClientGoal, FeedbackCallback
from simple_ros.actions.goal import message_as
from simple_ros.actions.messages import ActionNames, messages_of
from simple_ros.actions.states import GoalState
from simple_ros.callbacks import CallbackGuard
from simple_ros.errors import (
    ActionServerLost,
    CancelRejected,
    GoalRejected,
    HandleClosed,
    MasterUnavailable,
    ServiceCallError,
    ServiceTimeout,
    ServiceUnavailable,
    UnknownGoal,
)
from simple_ros.msg.action_msgs import CancelGoalRequest, CancelGoalResponse, GoalStatusArray
from simple_ros.msg.interfaces import ActionType
from simple_ros.qos import LATCHED

if TYPE_CHECKING:
    from simple_ros.node import NodeHandle
    from simple_ros.subscriber import Subscriber

__all__ = ["ActionClient"]

logger = logging.getLogger(__name__)

GoalT = TypeVar("GoalT", bound=Message)
ResultT = TypeVar("ResultT", bound=Message)
FeedbackT = TypeVar("FeedbackT", bound=Message)

_STATES = frozenset(state.value for state in GoalState)
_LINK_S = 1.0
_WITHDRAW_S = 2.0
_CLOSING_S = 0.3
_LINGER_S = 2.0


class ActionClient(Generic[GoalT, ResultT, FeedbackT]):
    """Sends goals to one action. Made by `NodeHandle.action_client`.

    Attributes:
        name: Canonical name of the action.
        type: Its messages.
    """

    def __init__(
        self, node: NodeHandle, name: str, kind: ActionType[GoalT, ResultT, FeedbackT]
    ) -> None:
        self.name = name
        self.type = kind
        self.guard = CallbackGuard(f"feedback of {name!r}")
        self._node = node
        self._names = ActionNames(name)
        self._messages = messages_of(kind)
        self._send = node.service_client(self._names.send_goal, self._messages.send_goal)
        self._cancel = node.service_client(self._names.cancel_goal, self._messages.cancel_goal)
        self._result = node.service_client(self._names.get_result, self._messages.get_result)
        self._loop = asyncio.get_running_loop()
        self._goals: dict[bytes, ClientGoal[ResultT, FeedbackT]] = {}
        self._listening = asyncio.Lock()
        self._subscriptions: list[Subscriber[Any]] = []
        self._linked = asyncio.Event()
        self._withdrawals: set[asyncio.Task[None]] = set()
        self._closed = False

    # -- goals ---------------------------------------------------------------------------------

    async def send_goal(
        self,
        goal: GoalT,
        *,
        feedback: FeedbackCallback[FeedbackT] | None = None,
        timeout: float | None = None,
    ) -> ClientGoal[ResultT, FeedbackT]:
        """Send a goal; returns when the server has accepted it.

        Args:
            goal: What is to be reached.
            feedback: Called with each feedback message, on the event loop.
            timeout: Seconds to wait for the server's answer; None for as long as it lives. If it does not
                come in time the goal is taken back.

        Raises:
            TypeError: The goal is of another type than the action's, or ``feedback`` is a coroutine function.
            GoalRejected: The server refuses it.
            ServiceUnavailable: There is no server, or it died before it answered.
            ServiceTimeout: No answer in time.
            ServiceTypeMismatch: The action has another type.
            MasterUnavailable: The server is not known yet and no Master answers.
            HandleClosed: The client or its node is closed.
        """
        self._check_open()
        request = self._messages.send_goal.request(
            goal=message_as(self.type.goal, goal, f"a goal of {self.name!r}")
        )
        handle = self._handle(uuid4(), feedback)
        handle.sent()
        request.goal_id = handle.goal_id.bytes
        try:
            answer = await self._answer_to(request, timeout)
        except BaseException as error:
            del self._goals[handle.goal_id.bytes]
            if isinstance(error, ServiceTimeout | asyncio.CancelledError):
                self._withdraw(handle.goal_id)
            raise
        if not answer.accepted:
            del self._goals[handle.goal_id.bytes]
            raise GoalRejected(self.name, handle.goal_id.hex, f"rejected ({answer.reason})")
        handle.accepted()
        return handle

    async def _answer_to(self, request: Any, timeout: float | None) -> Any:
        begun = self._loop.time()
        if not self._subscriptions:
            # Finding the server comes first: without one, or with one of another type, that is the error.
            await self._send._connected(timeout)
            try:
                async with asyncio.timeout(timeout):
                    await self.listen()
            except TimeoutError:
                reason = "its server could not be reached in time"
                raise ServiceTimeout(self._send.name, reason) from None
        if timeout is not None:
            timeout = max(timeout - (self._loop.time() - begun), 0.001)
        return await self._send.call(request, timeout=timeout)

    def goal(
        self,
        goal_id: UUID | bytes | str,
        *,
        feedback: FeedbackCallback[FeedbackT] | None = None,
    ) -> ClientGoal[ResultT, FeedbackT]:
        """A goal that was sent before, by whichever client: its result, further feedback, a way to cancel.

        Nothing is asked before something of it is awaited.

        Args:
            goal_id: As `ClientGoal.goal_id`; also its 16 bytes or 32 hexadecimal digits.
            feedback: Called with each feedback message from then on.

        Raises:
            ValueError: That is no id of a goal.
            HandleClosed: The client is closed.
        """
        self._check_open()
        identifier = _uuid(goal_id)
        known = self._goals.get(identifier.bytes)
        if known is None:
            return self._handle(identifier, feedback)
        if feedback is not None:
            known.take_feedback_by(feedback)
        return known

    def _handle(
        self, goal_id: UUID, feedback: FeedbackCallback[FeedbackT] | None
    ) -> ClientGoal[ResultT, FeedbackT]:
        handle: ClientGoal[ResultT, FeedbackT] = ClientGoal(self, goal_id, feedback)
        self._goals[goal_id.bytes] = handle
        return handle

    async def cancel_all(self, before: float | None = None) -> list[UUID]:
        """Cancel every goal of the action, whoever sent it.

        Args:
            before: Only those accepted until then, in seconds since 1970 on the server's clock.

        Returns:
            The goals that are about to end.

        Raises:
            CancelRejected: The server refuses all of it.
            ServiceUnavailable: There is no server.
        """
        request = CancelGoalRequest()
        if before is not None:
            request.goal_info.stamp.FromNanoseconds(max(1, round(before * 1e9)))
        answer = await self._cancel.call(request)
        if answer.return_code == CancelGoalResponse.ERROR_REJECTED:
            raise CancelRejected(self.name, "", "the server refuses to cancel its goals")
        return [UUID(bytes=info.goal_id) for info in answer.goals_canceling]

    async def wait_for_server(self, timeout: float | None = None) -> None:
        """Return when there is a server and it can be called.

        Raises:
            TimeoutError: Not within ``timeout`` seconds.
            ServiceTypeMismatch: The action has another type.
        """
        await self._send.wait_for_service(timeout)

    # -- what its goals ask --------------------------------------------------------------------

    async def cancel_goal(self, goal_id: UUID) -> bool:
        """Ask for the end of a goal (called by it); False if it has ended already."""
        request = CancelGoalRequest()
        request.goal_info.goal_id = goal_id.bytes
        answer = await self._cancel.call(request)
        match answer.return_code:
            case CancelGoalResponse.ERROR_REJECTED:
                reason = "the server refuses to cancel it"
                raise CancelRejected(self.name, goal_id.hex, reason)
            case CancelGoalResponse.ERROR_UNKNOWN_GOAL_ID:
                raise UnknownGoal(self.name, goal_id.hex, "the server knows no such goal")
            case code:
                return bool(code == CancelGoalResponse.ERROR_NONE)

    async def fetch(self, goal_id: UUID) -> Any:
        """The result of a goal, once it has ended (called by it).

        A connection that broke while the server lives is made once more.
        """
        self._check_open()
        request = self._messages.get_result.request(goal_id=goal_id.bytes)
        lost = ""
        try:
            answer = await self._result.call(request)
        except ServiceUnavailable as error:
            lost = error.reason
            try:
                answer = await self._result.call(request)
            except (ServiceUnavailable, MasterUnavailable):
                raise ActionServerLost(self.name, goal_id.hex, lost) from None
        if answer.status == GoalState.UNKNOWN:
            if lost:
                raise ActionServerLost(self.name, goal_id.hex, f"{lost}, and another is there now")
            raise UnknownGoal(self.name, goal_id.hex, "the server knows no such goal")
        return answer

    def _withdraw(self, goal_id: UUID) -> None:
        """Nobody waits for a goal whose acceptance is not known."""

        async def ask() -> None:
            request = CancelGoalRequest()
            request.goal_info.goal_id = goal_id.bytes
            try:
                await self._cancel.call(request, timeout=_WITHDRAW_S)
            except (ServiceCallError, MasterUnavailable, HandleClosed) as error:
                logger.info("goal %s was not taken back: %s", goal_id.hex, error)

        if not self._closed and not self._node.is_closed:
            task = self._loop.create_task(ask(), name=f"withdraw {goal_id.hex}")
            self._withdrawals.add(task)
            task.add_done_callback(self._withdrawals.discard)

    # -- what the server says ------------------------------------------------------------------

    async def listen(self) -> None:
        """Subscribe to feedback and status; returns when the server is linked, or after 1 s."""
        async with self._listening:
            if self._subscriptions:
                return
            self._check_open()
            names, messages = self._names, self._messages
            found: list[Subscriber[Any]] = []
            try:
                found.append(
                    await self._node.subscribe(
                        names.status, messages.status, self._status_came, qos=LATCHED
                    )
                )
                found.append(
                    await self._node.subscribe(
                        names.feedback, messages.feedback, self._feedback_came, qos=LATCHED
                    )
                )
            except BaseException:
                for subscription in found:
                    await subscription.close()
                raise
            self._subscriptions = found
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_LINK_S):
                    await self._linked.wait()

    def _feedback_came(self, message: Any) -> None:
        self._linked.set()
        goal = self._goals.get(message.goal_id)
        if goal is not None:
            goal.feedback_came(message.feedback, message.number)

    def _status_came(self, message: GoalStatusArray) -> None:
        for entry in message.status_list:
            goal = self._goals.get(entry.goal_info.goal_id)
            if goal is not None:
                goal.heard(
                    GoalState(entry.status) if entry.status in _STATES else GoalState.UNKNOWN
                )

    def goal_ended(self, goal_id: UUID) -> None:
        """A goal has ended (called by it); its last feedback may still be on the way."""
        self._loop.call_later(_LINGER_S, self._goals.pop, goal_id.bytes, None)

    # -- the end -------------------------------------------------------------------------------

    def _check_open(self) -> None:
        if self._closed or self._node.is_closed:
            raise HandleClosed(f"client of action {self.name!r}")

    async def close(self) -> None:
        """Send no more and hear no more; goals under way go on at the server."""
        if not self._closed:
            self.abandon()
            self._node.action_handles.discard(self)
            for subscription in self._subscriptions:
                await subscription.close()

    async def finish(self, caller: asyncio.Task[Any] | None) -> None:
        """Let goals be taken back that nobody waits for (called by the node when it closes)."""
        if self._withdrawals - {caller}:
            await asyncio.wait(self._withdrawals - {caller}, timeout=_CLOSING_S)

    def abandon(self, caller: asyncio.Task[Any] | None = None) -> None:  # noqa: ARG002
        """End at once (called by the node)."""
        self._closed = True
        for task in list(self._withdrawals):
            task.cancel()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    def __repr__(self) -> str:
        return f"<ActionClient {self.name} [{self.type.name}]>"


def _uuid(given: UUID | bytes | str) -> UUID:
    if isinstance(given, UUID):
        return given
    try:
        return UUID(bytes=given) if isinstance(given, bytes) else UUID(hex=given)
    except ValueError:
        raise ValueError(
            f"{given!r} is no id of a goal: it is 16 bytes, or 32 hexadecimal digits"
        ) from None
