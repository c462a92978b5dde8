"""What is known of the robot besides its radio: how fast it is, which of its sensors are at work. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterable

from simple_ros.msg.visualization_msgs import ADD, DELETE, DELETEALL, Marker

__all__ = ["RobotState"]

_FRESH_S = 2.0


class RobotState:
    """One robot."""

    def __init__(self) -> None:
        self._speed_mps = 0.0
        self._told_s = -math.inf
        self._sensors: dict[tuple[str, int], float] = {}

    def moves(self, x_mps: float, y_mps: float, z_mps: float, now_s: float) -> None:
        """It has this velocity now; one that is no number is left out."""
        speed = math.sqrt(x_mps**2 + y_mps**2 + z_mps**2)
        if math.isfinite(speed):
            self._speed_mps, self._told_s = speed, now_s

    def speed_mps(self, now_s: float) -> float | None:
        """How fast it is; None if nobody told for 2 s."""
        return self._speed_mps if now_s - self._told_s <= _FRESH_S else None

    def sensors(self, markers: Iterable[Marker], now_s: float) -> None:
        """Sensors are at work (a marker is added) or no longer (deleted)."""
        for marker in markers:
            key = (marker.ns, marker.id)
            if marker.action == DELETEALL:
                self._sensors.clear()
            elif marker.action == DELETE:
                self._sensors.pop(key, None)
            elif marker.action == ADD:
                self._sensors[key] = now_s + marker.lifetime if marker.lifetime else math.inf

    def sensor_count(self, now_s: float) -> int:
        """How many are at work; 0 if nobody tells."""
        self._sensors = {key: end for key, end in self._sensors.items() if end > now_s}
        return len(self._sensors)
