"""What an action server tells whoever listens: feedback, and the states of its goals."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

from simple_ros.actions.book import GoalBook
from simple_ros.actions.messages import ActionMessages, ActionNames
from simple_ros.msg.action_msgs import GoalStatusArray
from simple_ros.qos import LATCHED

if TYPE_CHECKING:
    from simple_ros.node import NodeHandle
    from simple_ros.publisher import Publisher

__all__ = ["Reports"]

_FEEDBACK = LATCHED.replace(depth=100)
_ENDED = 20


class Reports:
    """The two topics of an action.

    Both are latched, so a client that has heard something on one knows that it is linked.

    Args:
        book: Whose goals are reported: those under way, and the last 20 that ended.
    """

    def __init__(self, book: GoalBook) -> None:
        self._book = book
        self._feedback: Publisher[Any] | None = None
        self._status: Publisher[GoalStatusArray] | None = None
        self._loop = asyncio.get_running_loop()
        self._due = False
        self._over = False

    async def open(self, node: NodeHandle, names: ActionNames, messages: ActionMessages) -> None:
        """Advertise both, and say on both that there is nothing yet."""
        self._feedback = await node.advertise(names.feedback, messages.feedback, qos=_FEEDBACK)
        self._status = await node.advertise(names.status, messages.status, qos=LATCHED)
        self._feedback.publish(messages.feedback())
        self._status.publish(GoalStatusArray())

    def feedback(self, message: Any) -> None:
        """Publish feedback."""
        assert self._feedback is not None
        self._feedback.publish(message)

    def states_changed(self) -> None:
        """Publish the states at the end of the tick, however many of them change in it."""
        if not self._due and not self._over:
            self._due = True
            self._loop.call_soon(self._is_due)

    def _is_due(self) -> None:
        self._due = False
        if not self._over:
            self._publish_states()

    def _publish_states(self) -> None:
        if self._status is None:
            return
        array = GoalStatusArray()
        for record in (*self._book.last_ended(_ENDED), *self._book.active):
            entry = array.status_list.add(status=record.state.value)
            entry.goal_info.goal_id = record.goal_id
            entry.goal_info.stamp.FromNanoseconds(record.stamp_ns)
        self._status.publish(array)

    def end(self) -> None:
        """Publish the states once more, and nothing afterwards."""
        self._over = True
        self._publish_states()

    async def close(self) -> None:
        """Stop publishing."""
        for publisher in (self._feedback, self._status):
            if publisher is not None:
                await publisher.close()
