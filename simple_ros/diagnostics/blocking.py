"""The updater for programs without an event loop; tasks run in the thread that spins."""

from __future__ import annotations

from typing import Self

from simple_ros.blocking import BlockingNode
from simple_ros.clock import Clock
from simple_ros.diagnostics.nodes import DIAGNOSTICS_TOPIC, QOS
from simple_ros.diagnostics.status import Level
from simple_ros.diagnostics.tasks import Task, Tasks
from simple_ros.faces import clock_of
from simple_ros.msg.diagnostic_msgs import DiagnosticArray

__all__ = ["DiagnosticUpdater"]


class DiagnosticUpdater:
    """Looks at its tasks once a second and sends what it finds on ``diagnostics``.

    Args:
        node: A blocking node.
        hardware_id: The device it is about, if any.
        period_s: Seconds between looks.

    Raises:
        ConfigError: The period is not a positive number.

    Attributes:
        tasks: What it looks at.
    """

    def __init__(self, node: BlockingNode, *, hardware_id: str = "", period_s: float = 1.0) -> None:
        self.tasks = Tasks(node.name, hardware_id)
        self._clock: Clock = clock_of(node)
        self._publisher = node.advertise(DIAGNOSTICS_TOPIC, DiagnosticArray, qos=QOS)
        self._timer = node.create_timer(period_s, lambda _: self.update())

    def add(self, name: str, *tasks: Task) -> None:
        """Look at something each time: a function that is given a `Status`, or a monitor.

        Raises:
            ConfigError: There is a task of that name.
        """
        self.tasks.add(name, *tasks)

    def remove(self, name: str) -> None:
        """Look at it no more.

        Raises:
            LookupError: There is no task of that name.
        """
        self.tasks.remove(name)

    def update(self) -> None:
        """Look and send now."""
        self._publisher.publish(self.tasks.look(self._clock.now()))

    def broadcast(self, level: Level, message: str) -> None:
        """Send the same for every task, such as at start or end."""
        self._publisher.publish(self.tasks.say(self._clock.now(), level, message))

    def now(self) -> float:
        """The time that monitors are told, in seconds."""
        return self._clock.now().seconds

    def close(self) -> None:
        """Look and send no more."""
        self._timer.close()
        self._publisher.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
