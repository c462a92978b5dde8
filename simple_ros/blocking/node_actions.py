"""What a blocking node does with actions."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar, cast

from google.protobuf.message import Message

from simple_ros.actions.book import GoalPolicy
from simple_ros.actions.server import ActionServer as AsyncActionServer
from simple_ros.blocking.action import ActionClient, ActionServer, ServerGoal
from simple_ros.blocking.service import SpinningHandler
from simple_ros.message_queue import DEFAULT_GROUP, CallbackGroup
from simple_ros.msg.interfaces import ActionType

if TYPE_CHECKING:
    from simple_ros.blocking.node import BlockingNode

__all__ = ["ActionMethods"]

GoalT = TypeVar("GoalT", bound=Message)
ResultT = TypeVar("ResultT", bound=Message)
FeedbackT = TypeVar("FeedbackT", bound=Message)


class ActionMethods:
    """Part of `BlockingNode`."""

    @property
    def _own_node(self) -> BlockingNode:
        return cast("BlockingNode", self)

    def advertise_action(
        self,
        name: str,
        action: ActionType[GoalT, ResultT, FeedbackT] | tuple[type[Any], ...] | str,
        execute: Callable[[ServerGoal[GoalT, ResultT, FeedbackT]], ResultT | None],
        *,
        on_goal: Callable[[GoalT], bool | str] | None = None,
        on_cancel: Callable[[ServerGoal[GoalT, ResultT, FeedbackT]], bool] | None = None,
        policy: GoalPolicy = "parallel",
        result_timeout_s: float = 900.0,
        max_goals: int = 1000,
        max_results: int = 1000,
        group: CallbackGroup = DEFAULT_GROUP,
    ) -> ActionServer[GoalT, ResultT, FeedbackT]:
        """Execute the goals of an action; see `simple_ros.aio.NodeHandle.advertise_action`.

        Args:
            name: Its name.
            action: Its type.
            execute: Called with each goal in a thread that spins; returns the result. A cancel does not
                interrupt it: it looks at ``is_cancel_requested``, or sleeps by ``wait_cancel_requested``.
            on_goal: Asked in a thread that spins: while the only one executes a goal, that waits.
            on_cancel: As ``on_goal``. Without it, cancels need no thread.
            policy: What happens when a goal comes while another one is under way.
            result_timeout_s: How long results are kept, in seconds.
            max_goals: How many goals may be under way or wait.
            max_results: How many results are kept.
            group: What ``execute`` may run at the same time with, if several threads spin; for goals that
                run at the same time as each other, ``CallbackGroup(reentrant=True)``.
        """
        node = self._own_node
        loop, asked = node._loop, CallbackGroup(reentrant=True)
        handlers: list[SpinningHandler] = []

        def spinning(function: Callable[[Any], Any], among: CallbackGroup) -> SpinningHandler:
            handlers.append(SpinningHandler(node._executor, name, function, max_goals, among))
            return handlers[-1]

        executing = spinning(lambda goal: execute(ServerGoal(loop, goal)), group)
        judging = None if on_goal is None else spinning(on_goal, asked)
        canceling = None
        if on_cancel is not None:
            canceling = spinning(lambda goal: on_cancel(ServerGoal(loop, goal)), asked)
        try:
            server: AsyncActionServer[GoalT, ResultT, FeedbackT] = loop.run(
                node._node.advertise_action(
                    name,
                    action,
                    executing,
                    on_goal=judging,
                    on_cancel=canceling,
                    policy=policy,
                    interrupt=False,
                    result_timeout_s=result_timeout_s,
                    max_goals=max_goals,
                    max_results=max_results,
                )
            )
        except BaseException:
            for handler in handlers:
                handler.close()
            raise
        return ActionServer(loop, server, tuple(handlers))

    def action_client(
        self,
        name: str,
        action: ActionType[GoalT, ResultT, FeedbackT] | tuple[type[Any], ...] | str,
    ) -> ActionClient[GoalT, ResultT, FeedbackT]:
        """A client of an action; see `simple_ros.aio.NodeHandle.action_client`."""
        node = self._own_node

        async def made() -> ActionClient[GoalT, ResultT, FeedbackT]:
            client = node._node.action_client(name, action)
            endpoints = node._node.endpoints

            def is_own(action: str) -> bool:
                return endpoints.service_named(f"{action}/_action/send_goal") is not None

            return ActionClient(node._loop, node._executor, client, is_own)

        return node._loop.run(made())
