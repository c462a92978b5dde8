"""What both faces of a node have in common, for helpers that serve either."""

from __future__ import annotations

from simple_ros.blocking import BlockingNode
from simple_ros.blocking.clock import BlockingClock
from simple_ros.clock import Clock
from simple_ros.net.loop import BackgroundLoop
from simple_ros.node import NodeHandle

__all__ = ["clock_of", "parts_of"]


def parts_of(node: BlockingNode) -> tuple[BackgroundLoop, NodeHandle]:
    """The loop a blocking node lives on, and the asyncio node it forwards to."""
    return node._loop, node._node


def clock_of(node: BlockingNode) -> Clock:
    """The clock of a blocking node, of which ``now`` may be called from any thread."""
    return BlockingClock.attach(*parts_of(node)).clock
