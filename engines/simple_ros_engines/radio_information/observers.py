"""Who wants to be told of each channel state, in the engine's process or in another."""

from __future__ import annotations

import logging
from typing import Protocol

from simple_ros.msg.wireless_ros_msgs import ChannelState
from simple_ros.node import NodeHandle
from simple_ros.qos import QosProfile
from simple_ros.subscriber import Subscriber

__all__ = ["ChannelObserver", "Observers", "observe_channels"]

logger = logging.getLogger(__name__)


class ChannelObserver(Protocol):
    """Is told of each channel state."""

    def on_channel_update(self, state: ChannelState) -> None:
        """A link has a new state.

        Args:
            state: Shared with others: to be read, not changed.
        """


class Observers:
    """Observers that do not hear of each other's errors."""

    def __init__(self) -> None:
        self.errors = 0
        self._observers: list[ChannelObserver] = []

    def register_observer(self, observer: ChannelObserver) -> bool:
        """Tell an observer from now on; False if it is told already."""
        if observer in self._observers:
            return False
        self._observers.append(observer)
        return True

    def unregister_observer(self, observer: ChannelObserver) -> bool:
        """Tell it no longer; False if it was not told."""
        if observer not in self._observers:
            return False
        self._observers.remove(observer)
        return True

    def notify_observers(self, state: ChannelState) -> None:
        """Tell all. What an observer raises is logged and counted."""
        for observer in tuple(self._observers):
            try:
                observer.on_channel_update(state)
            except Exception:
                self.errors += 1
                logger.exception("an observer of channel states failed")

    def __len__(self) -> int:
        return len(self._observers)


async def observe_channels(
    node: NodeHandle, observer: ChannelObserver, link_id: str = ""
) -> Subscriber[ChannelState]:
    """Tell an observer of what an engine in any process publishes, until the subscription is closed.

    Args:
        node: Subscribes.
        observer: Is told.
        link_id: Only of this link; empty for all.
    """

    def came(state: ChannelState) -> None:
        if link_id in ("", state.link_id):
            observer.on_channel_update(state)

    return await node.subscribe(
        "/wireless_ros/channel_state", ChannelState, came, qos=QosProfile(depth=100)
    )
