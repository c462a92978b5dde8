"""Waiting for the end of a goal while the user may want it to end sooner."""

from __future__ import annotations

import asyncio
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from simple_ros.cli.action.display import CANCELED, Display
from simple_ros.errors import ActionError, ServiceCallError, SimpleRosError

if TYPE_CHECKING:
    from simple_ros.actions.client_goal import ClientGoal

__all__ = ["follow"]


async def follow(
    goal: ClientGoal[Any, Any],
    action: str,
    show: Display,
    timeout: float | None,
    cancel_after: float | None,
    *,
    may_cancel: bool = True,
) -> int:
    """Wait for the end of a goal and print it; returns the exit code.

    Args:
        goal: Which one.
        action: Name of its action.
        show: Prints.
        timeout: How long to wait, in seconds.
        cancel_after: After how many seconds to cancel it.
        may_cancel: Whether Ctrl-C cancels the goal, and only a second one ends the waiting.

    Raises:
        SimpleRosError: It has not ended in time, or its end cannot be known.
    """
    ending = asyncio.ensure_future(goal.outcome(timeout))
    wish = _Wish(goal, show, ending)
    loop = asyncio.get_running_loop()
    late = None
    if cancel_after is not None:
        reason = f"it takes longer than {cancel_after:g} s"
        late = loop.call_later(cancel_after, wish.cancel, reason)
    with _signals(wish.interrupted if may_cancel else lambda: ending.cancel()):
        try:
            await asyncio.wait((ending,))
        finally:
            ending.cancel()
            if late is not None:
                late.cancel()
            await wish.leave()
    if ending.cancelled():
        return CANCELED
    try:
        return show.ended(ending.result())
    except TimeoutError:
        raise SimpleRosError(
            f"the goal has not ended within {timeout:g} s and goes on; wait for it with "
            f"'simple-ros action result {action} {goal.goal_id.hex}'"
        ) from None


class _Wish:
    """The user's wish that a goal ends."""

    def __init__(
        self, goal: ClientGoal[Any, Any], show: Display, ending: asyncio.Future[Any]
    ) -> None:
        self._goal = goal
        self._show = show
        self._ending = ending
        self._asking: asyncio.Task[None] | None = None

    def interrupted(self) -> None:
        """Ctrl-C: cancel the goal; the second time, wait no longer."""
        if self._asking is None:
            self.cancel("Ctrl-C; once more to leave at once")
        else:
            self._ending.cancel()

    def cancel(self, reason: str) -> None:
        """Ask the server."""
        if self._asking is None:
            self._show.canceling(reason)
            self._asking = asyncio.ensure_future(self._ask())

    async def _ask(self) -> None:
        try:
            await self._goal.cancel()
        except (ActionError, ServiceCallError) as error:
            print(f"warning: {error}", file=sys.stderr)

    async def leave(self) -> None:
        """Ask no more."""
        if self._asking is not None:
            self._asking.cancel()
            await asyncio.wait((self._asking,))


@contextmanager
def _signals(handle: Callable[[], object]) -> Iterator[None]:
    """Call on Ctrl-C and SIGTERM meanwhile, in place of what they do otherwise."""
    loop = asyncio.get_running_loop()
    numbers = (signal.SIGINT, signal.SIGTERM)
    for number in numbers:
        loop.add_signal_handler(number, handle)
    try:
        yield
    finally:
        for number in numbers:
            # Nothing of the goal is left to be asked; what is left is done soon.
            loop.add_signal_handler(number, lambda: None)
