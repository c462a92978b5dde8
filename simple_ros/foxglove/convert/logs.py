"""Log lines."""

from __future__ import annotations

from foxglove_schemas_protobuf.Log_pb2 import Log as FoxgloveLog

from simple_ros.foxglove.convert.base import Context
from simple_ros.foxglove.convert.common import stamp_of
from simple_ros.msg.rosgraph_msgs import Log

__all__ = ["log_line"]

_LEVELS = (
    (Log.FATAL, FoxgloveLog.FATAL),
    (Log.ERROR, FoxgloveLog.ERROR),
    (Log.WARN, FoxgloveLog.WARNING),
    (Log.INFO, FoxgloveLog.INFO),
    (Log.DEBUG, FoxgloveLog.DEBUG),
)


def log_line(message: Log, context: Context) -> FoxgloveLog:
    """A log line; a level between two counts as the lower one."""
    level = next((ours for ros, ours in _LEVELS if message.level >= ros), FoxgloveLog.UNKNOWN)
    return FoxgloveLog(
        timestamp=stamp_of(message.header, context),
        level=level,
        message=message.msg,
        name=message.name,
        file=message.file,
        line=message.line,
    )
