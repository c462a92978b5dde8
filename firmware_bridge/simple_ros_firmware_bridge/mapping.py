"""Names: what a board calls a topic or type, and what the graph calls it.

A micro-ROS board says ``rt/odom`` and ``nav_msgs::msg::dds_::Odometry_``; the graph says ``odom`` and
``nav_msgs.Odometry``. Topics of the first firmware (``/ddd/...``) get their standard names.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from simple_ros.names import topic_name

__all__ = ["STANDARD_NAMES", "TopicMap", "graph_type", "plain"]

STANDARD_NAMES: Mapping[str, str] = {
    "ddd/imu": "imu/data_raw",
    "ddd/odom": "odom",
    "ddd/range_tof": "sensors/range_tof",
    "ddd/range": "sensors/range_ultrasonic",
    "ddd/illuminance": "sensors/illuminance",
    "ddd/cmd_vel": "cmd_vel",
}
"""Old names of the robot_xl firmware, and the standard ones."""

_DDS_TYPE = re.compile(r"^(\w+)::(?:msg|srv)::dds_::(\w+?)(?:_(Request|Response))?_$")


def plain(name: str) -> str:
    """A topic of a board without DDS's ``rt/`` and without a slash at its begin."""
    return name.lstrip("/").removeprefix("rt/").lstrip("/")


def graph_type(dds_name: str) -> str:
    """``nav_msgs.Odometry`` for ``nav_msgs::msg::dds_::Odometry_``; empty if it is no such name.

    ``std_srvs::srv::dds_::SetBool_Request_`` is ``std_srvs.SetBoolRequest``.
    """
    found = _DDS_TYPE.match(dds_name)
    return f"{found[1]}.{found[2]}{found[3] or ''}" if found else ""


@dataclass(frozen=True)
class TopicMap:
    """From topics of a board to topics of the graph.

    Attributes:
        remap: Further names, by the name on the board; they win over `STANDARD_NAMES`. Both may be
            written with ``/`` or ``/rt/`` before them.
        prefix: Namespace of the board, for several boards on one robot; an absolute name of `remap`
            (with a slash) is outside of it.
    """

    remap: Mapping[str, str] = field(default_factory=dict)
    prefix: str = ""

    def topic(self, board_name: str) -> str:
        """The graph's name for a topic of the board; without a slash it is in the node's namespace.

        Raises:
            InvalidName: It is no name of a topic.
        """
        name = plain(board_name)
        table = {plain(old): new for old, new in self.remap.items()}
        new = table.get(name)
        if new is None:
            new = STANDARD_NAMES.get(name, name)
        if new.startswith("/") and not new.startswith("/rt/"):
            return "/" + topic_name(new)
        prefix = self.prefix.strip("/")
        return topic_name(f"{prefix}/{plain(new)}" if prefix else plain(new))
