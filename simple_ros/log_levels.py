"""Levels of log lines: Python's 10 to 50, ROS's 1 to 16, and their names."""

from __future__ import annotations

from simple_ros.errors import ConfigError
from simple_ros.msg.rosgraph_msgs import Log

__all__ = ["LEVEL_NAMES", "level_name", "python_level", "ros_level"]

LEVEL_NAMES = ("debug", "info", "warn", "error", "fatal")

_BY_NAME = {
    "debug": 10,
    "info": 20,
    "warn": 30,
    "warning": 30,
    "error": 40,
    "fatal": 50,
    "critical": 50,
}


def python_level(level: str | int) -> int:
    """A level of `logging` from its name, in any case and of ROS or Python, or from its number.

    Raises:
        ConfigError: There is no such level.
    """
    if isinstance(level, int) and not isinstance(level, bool):
        if level < 0:
            raise ConfigError(f"a log level is not negative, but this is {level}")
        return level
    found = _BY_NAME.get(str(level).strip().lower())
    if found is None:
        raise ConfigError(f"a log level is one of {', '.join(LEVEL_NAMES)}, not {level!r}")
    return found


def ros_level(level: int) -> Log.Level.ValueType:
    """The level of a `rosgraph_msgs.Log` for one of `logging`; in between, the lower one counts."""
    for bound, found in ((50, Log.FATAL), (40, Log.ERROR), (30, Log.WARN), (20, Log.INFO)):
        if level >= bound:
            return found
    return Log.DEBUG


def level_name(level: int) -> str:
    """The name of the level of a `rosgraph_msgs.Log`, such as ``warn``; a number if it has none."""
    names = dict(
        zip((Log.DEBUG, Log.INFO, Log.WARN, Log.ERROR, Log.FATAL), LEVEL_NAMES, strict=True)
    )
    return next((name for known, name in names.items() if known == level), str(level))
