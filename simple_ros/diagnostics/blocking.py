"""The updater for programs without an event loop; tasks run in the thread that spins."""

from __future__ import annotations

from typing import Self

from simple_ros.blocking import BlockingNode
from simple_ros.diagnostics.nodes import DIAGNOSTICS_TOPIC, QOS, UpdaterBase
from simple_ros.diagnostics.tasks import Tasks
from simple_ros.faces import clock_of
from simple_ros.msg.diagnostic_msgs import DiagnosticArray

__all__ = ["DiagnosticUpdater"]


class DiagnosticUpdater(UpdaterBase):
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
        self._clock = clock_of(node)
        self._publisher = node.advertise(DIAGNOSTICS_TOPIC, DiagnosticArray, qos=QOS)
        self._send = self._publisher.publish
        self._timer = node.create_timer(period_s, lambda _: self.update())

    def close(self) -> None:
        """Look and send no more."""
        self._timer.close()
        self._publisher.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
