"""What the user's callbacks say about a goal: whether it is accepted, whether it may be canceled."""

from __future__ import annotations

import logging
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

from google.protobuf.message import Message

from simple_ros.actions.goal import ServerGoal
from simple_ros.callbacks import CALLBACK_ERRORS, CallbackGuard, is_async, is_being_cancelled

__all__ = ["Asking", "CancelCallback", "GoalCallback"]

logger = logging.getLogger(__name__)

GoalT = TypeVar("GoalT", bound=Message)
GoalCallback = (
    Callable[[GoalT], bool | str] | Callable[[GoalT], Coroutine[Any, Any, bool | str]] | None
)
CancelCallback = (
    Callable[[ServerGoal[Any, Any, Any]], bool]
    | Callable[[ServerGoal[Any, Any, Any]], Coroutine[Any, Any, bool]]
    | None
)


class Asking:
    """Asks the callbacks of one action; one that raises or gives something else refuses.

    Args:
        guard: Notes exceptions.
        on_goal: None accepts everything.
        on_cancel: None grants everything.
    """

    def __init__(self, guard: CallbackGuard, on_goal: Any, on_cancel: Any) -> None:
        self._guard = guard
        self._on_goal = on_goal
        self._on_cancel = on_cancel

    async def refusal(self, goal: Message) -> str:
        """Why a goal is refused; empty if it is not."""
        if self._on_goal is None:
            return ""
        verdict = await self._asked(self._on_goal, goal)
        match verdict:
            case True:
                return ""
            case str() if verdict:
                return verdict
            case False | "":
                return "the server refuses it"
            case BaseException():
                return f"on_goal raised {type(verdict).__name__}: {verdict}"
            case _:
                return f"on_goal returned {verdict!r}"

    async def may_cancel(self, goal: ServerGoal[Any, Any, Any]) -> bool:
        """Whether a goal may be canceled."""
        if self._on_cancel is None:
            return True
        verdict = await self._asked(self._on_cancel, goal)
        if not isinstance(verdict, bool | BaseException):
            logger.warning("%r: on_cancel returned %r, which refuses", goal, verdict)
        return verdict is True

    async def _asked(self, callback: Any, argument: Any) -> Any:
        """What a callback says; an exception of it is noted and given back."""
        try:
            verdict = callback(argument)
            return await verdict if is_async(callback) else verdict
        except CALLBACK_ERRORS as error:
            if is_being_cancelled():
                raise
            self._guard.failed(error)
            return error
