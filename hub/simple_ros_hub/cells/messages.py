"""From a cell's status to its message. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from simple_ros.msg.wireless_ros_msgs import CellStatus

__all__ = ["cell_status"]

_SAME = (
    "name",
    "state",
    "detail",
    "executions",
    "errors",
    "execution_rate",
    "error_rate",
    "parameter_update_rate",
    "cpu_percent",
    "memory_bytes",
    "idle_s",
    "constraint_type",
)


def cell_status(status: Mapping[str, Any]) -> CellStatus:
    """The message of what `Cell.get_status` gives, with the children."""
    message = CellStatus(**{name: status[name] for name in _SAME})
    message.children.extend(cell_status(child) for child in status["children"])
    return message
