"""The tasks of an updater: pure, time is an argument."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Protocol

from simple_ros.diagnostics.status import ERROR, Level, Status
from simple_ros.errors import ConfigError
from simple_ros.msg.diagnostic_msgs import DiagnosticArray
from simple_ros.time import Time

__all__ = ["Check", "Task", "Tasks"]

logger = logging.getLogger(__name__)


class Check(Protocol):
    """Something that can be looked at, such as a `FrequencyMonitor`."""

    def run(self, status: Status, now_s: float) -> None:
        """Write down how it is."""


Task = Callable[[Status], object] | Check


class Tasks:
    """What is looked at, by name.

    Args:
        prefix: Name of the node, before the names of the tasks.
        hardware_id: The device they are about, if any.
    """

    def __init__(self, prefix: str, hardware_id: str = "") -> None:
        self.hardware_id = hardware_id
        self._prefix = prefix
        self._tasks: dict[str, tuple[Task, ...]] = {}
        self._failing: set[str] = set()
        self._seq = 0

    def add(self, name: str, *tasks: Task) -> None:
        """Look at something each time; several tasks under one name make one status.

        Raises:
            ConfigError: There is a task of that name, or none is given.
        """
        if name in self._tasks:
            raise ConfigError(f"there is a diagnostic task {name!r} already; remove it first")
        if not tasks:
            raise ConfigError(f"diagnostic task {name!r} has nothing to look at")
        self._tasks[name] = tasks

    def remove(self, name: str) -> None:
        """Look at it no more.

        Raises:
            LookupError: There is no task of that name.
        """
        if self._tasks.pop(name, None) is None:
            raise LookupError(f"there is no diagnostic task {name!r}")
        self._failing.discard(name)

    def look(self, now: Time) -> DiagnosticArray:
        """Run every task; one that raises is an error in its own status."""
        return self._array(now, [self._status(name, now.seconds) for name in list(self._tasks)])

    def say(self, now: Time, level: Level, message: str) -> DiagnosticArray:
        """The same level and text for every task, such as at start or end."""
        statuses = [self._named(name) for name in self._tasks]
        for status in statuses:
            status.summary(level, message)
        return self._array(now, statuses)

    def _named(self, name: str) -> Status:
        return Status(f"{self._prefix}: {name}", self.hardware_id)

    def _status(self, name: str, now_s: float) -> Status:
        status = self._named(name)
        for task in self._tasks.get(name, ()):
            try:
                if callable(task):
                    task(status)
                else:
                    task.run(status, now_s)
            except Exception as error:
                self._failed(name, status, error)
                break
        else:
            self._failing.discard(name)
        return status

    def _failed(self, name: str, status: Status, error: Exception) -> None:
        status.summary(ERROR, f"the task raised {type(error).__name__}: {error}")
        if name not in self._failing:
            self._failing.add(name)
            logger.error("diagnostic task %r raised", name, exc_info=error)

    def _array(self, now: Time, statuses: list[Status]) -> DiagnosticArray:
        self._seq += 1
        array = DiagnosticArray(status=[status.to_message() for status in statuses])
        array.header.seq = self._seq
        array.header.stamp.CopyFrom(now.to_msg())
        return array
