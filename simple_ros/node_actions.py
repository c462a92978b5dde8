"""What a node does with actions."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any, TypeVar, cast

from google.protobuf.message import Message

from simple_ros.actions.asking import CancelCallback, GoalCallback
from simple_ros.actions.book import GoalBook, GoalPolicy
from simple_ros.actions.client import ActionClient
from simple_ros.actions.server import ActionServer, Execute
from simple_ros.msg.interfaces import ActionType, action_type

if TYPE_CHECKING:
    from simple_ros.node import NodeHandle

__all__ = ["ActionMethods"]

GoalT = TypeVar("GoalT", bound=Message)
ResultT = TypeVar("ResultT", bound=Message)
FeedbackT = TypeVar("FeedbackT", bound=Message)


class ActionMethods:
    """Part of `NodeHandle`."""

    def _init_actions(self) -> None:
        self.action_handles: set[ActionServer[Any, Any, Any] | ActionClient[Any, Any, Any]] = set()

    @property
    def _own_node(self) -> NodeHandle:
        return cast("NodeHandle", self)

    async def advertise_action(
        self,
        name: str,
        action: ActionType[GoalT, ResultT, FeedbackT] | tuple[type[Any], ...] | str,
        execute: Execute[GoalT, ResultT, FeedbackT],
        *,
        on_goal: GoalCallback[GoalT] = None,
        on_cancel: CancelCallback = None,
        policy: GoalPolicy = "parallel",
        interrupt: bool = True,
        result_timeout_s: float = 900.0,
        max_goals: int = 1000,
        max_results: int = 1000,
    ) -> ActionServer[GoalT, ResultT, FeedbackT]:
        """Execute the goals of an action; returns when the Master knows it (and waits for a Master).

        Args:
            name: Its name; relative to the node's namespace unless it begins with a slash.
            action: Its type: as exported by the message packages (``example_interfaces.Fibonacci``), three
                message classes, or a name.
            execute: Called with each goal, a `ServerGoal`; returns the result, or ends the goal by its
                ``abort`` or ``canceled``. A coroutine function may wait; a plain one runs on the event loop.
                What it raises aborts the goal, and the client sees class and text.
            on_goal: Asked with each goal message: True accepts it, False refuses it, and so does a text,
                which the client sees. Without it every goal is accepted.
            on_cancel: Asked with the `ServerGoal` that a client wants canceled: True or False. Without it
                every wish is granted.
            policy: What happens when a goal comes while another one is under way: ``"parallel"`` runs both,
                ``"queue"`` lets it wait, ``"reject"`` refuses it, ``"preempt"`` cancels the other one
                (``on_cancel`` is not asked) and starts when that has ended.
            interrupt: Whether a cancel also cancels the coroutine of ``execute``: CancelledError comes out
                of what it awaits. If not, it looks at ``is_cancel_requested`` itself.
            result_timeout_s: How long the result of a goal is kept after its end, in seconds.
            max_goals: How many goals may be under way or wait; further ones are refused.
            max_results: How many results are kept; of more, fetched ones go first, then the oldest.

        Raises:
            InvalidName: The name breaks the rules.
            UnknownMessageType: A type given by name is not known.
            ConfigError: There is no such policy, or a number is out of range.
            RegistrationRefused: Another node has the action.
            ForeignMaster: The Master is C++ simple_ros, which knows no actions.
            HandleClosed: The node is closed.
        """
        node = self._own_node
        node._live_registrar()
        book = GoalBook(
            policy,
            result_timeout_s=result_timeout_s,
            max_goals=max_goals,
            max_results=max_results,
        )
        server: ActionServer[GoalT, ResultT, FeedbackT] = ActionServer(
            node,
            node.resolve_name(name, "action"),
            action_type(action),
            execute,
            book,
            on_goal=on_goal,
            on_cancel=on_cancel,
            interrupt=interrupt,
        )
        await server.open()
        self.action_handles.add(server)
        return server

    def action_client(
        self,
        name: str,
        action: ActionType[GoalT, ResultT, FeedbackT] | tuple[type[Any], ...] | str,
    ) -> ActionClient[GoalT, ResultT, FeedbackT]:
        """A client of an action, which need not be there yet.

        Args:
            name: Its name.
            action: Its type, as for `advertise_action`.

        Raises:
            InvalidName: The name breaks the rules.
            UnknownMessageType: A type given by name is not known.
            HandleClosed: The node is closed.
        """
        node = self._own_node
        node._live_registrar()
        client: ActionClient[GoalT, ResultT, FeedbackT] = ActionClient(
            node, node.resolve_name(name, "action"), action_type(action)
        )
        self.action_handles.add(client)
        return client

    async def _finish_actions(self, caller: asyncio.Task[Any] | None) -> None:
        await asyncio.gather(*(handle.finish(caller) for handle in list(self.action_handles)))

    def _abandon_actions(self, caller: asyncio.Task[Any] | None) -> None:
        for handle in list(self.action_handles):
            handle.abandon(caller)
