"""The Master of simple_ros: tells publishers who subscribes, and tools who is there."""

from simple_ros_master.graph import MessageGraph
from simple_ros_master.server import Master

__all__ = ["Master", "MessageGraph"]
