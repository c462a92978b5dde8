"""Driving a square by odometry: what to command, given where the robot is."""

from __future__ import annotations

import math
from enum import Enum

from simple_ros_firmware_bridge.mecanum import BodySpeed, Pose

__all__ = ["SquareDriver"]

_CORNERS = ((1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.0, 0.0))
_NEAR_M = 0.01
_STRAIGHT_RAD = 0.02
_GAIN = 2.5
_LEAST_M_S = 0.05
_LEAST_RAD_S = 0.08


class _Doing(Enum):
    DRIVE = "drive"
    TURN = "turn"


class SquareDriver:
    """Ahead to a corner, a quarter turn to the left, and so on; every error is driven out again.

    Args:
        side_m: Length of a side.
        speed_m_s: At most.
        turn_rad_s: At most.
    """

    def __init__(
        self, side_m: float = 1.0, speed_m_s: float = 0.4, turn_rad_s: float = 1.2
    ) -> None:
        self.squares = 0
        self.miss_m = 0.0
        self._side_m = side_m
        self._speed_m_s = speed_m_s
        self._turn_rad_s = turn_rad_s
        self._start: Pose | None = None
        self._corner = 0
        self._doing = _Doing.DRIVE

    def command(self, pose: Pose) -> BodySpeed:
        """What to do at this place. The square begins at the first of them.

        When it is back at its begin, `squares` is one more and `miss_m` says how far from it the robot is.
        """
        if self._start is None:
            self._start = pose
        x, y, yaw = self._from_start(pose)
        if self._doing is _Doing.DRIVE:
            command = self._driving(x, y, yaw)
            if command is not None:
                return command
            self._doing = _Doing.TURN
        command = self._turning(yaw)
        if command is None:
            self._next_side(x, y)
            return BodySpeed()
        return command

    def _from_start(self, pose: Pose) -> Pose:
        assert self._start is not None
        dx, dy = pose.x - self._start.x, pose.y - self._start.y
        cos, sin = math.cos(self._start.yaw), math.sin(self._start.yaw)
        turned = math.remainder(pose.yaw - self._start.yaw, 2 * math.pi)
        return Pose(cos * dx + sin * dy, -sin * dx + cos * dy, turned)

    def _driving(self, x: float, y: float, yaw: float) -> BodySpeed | None:
        corner_x, corner_y = _CORNERS[self._corner]
        dx, dy = corner_x * self._side_m - x, corner_y * self._side_m - y
        away = math.hypot(dx, dy)
        if away < _NEAR_M:
            return None
        speed = max(_LEAST_M_S, min(self._speed_m_s, _GAIN * away)) / away
        cos, sin = math.cos(yaw), math.sin(yaw)
        return BodySpeed(
            speed * (cos * dx + sin * dy),
            speed * (-sin * dx + cos * dy),
            self._turn_to(self._corner, yaw),
        )

    def _turning(self, yaw: float) -> BodySpeed | None:
        turn = self._turn_to(self._corner + 1, yaw)
        if abs(turn) < _GAIN * _STRAIGHT_RAD:
            return None
        return BodySpeed(wz=math.copysign(max(abs(turn), _LEAST_RAD_S), turn))

    def _turn_to(self, quarters: int, yaw: float) -> float:
        error = math.remainder(quarters * math.pi / 2 - yaw, 2 * math.pi)
        return max(-self._turn_rad_s, min(self._turn_rad_s, _GAIN * error))

    def _next_side(self, x: float, y: float) -> None:
        self._doing = _Doing.DRIVE
        self._corner = (self._corner + 1) % len(_CORNERS)
        if self._corner == 0:
            self.squares += 1
            self.miss_m = math.hypot(x, y)
