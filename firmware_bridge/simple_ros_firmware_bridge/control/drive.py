"""The mecanum drive controller: commands in, wheel speeds out, odometry from what the wheels did."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields

from simple_ros.errors import ConfigError
from simple_ros_firmware_bridge.mecanum import (
    BodySpeed,
    Mecanum,
    Pose,
    WheelSpeeds,
    integrated,
)

__all__ = ["DriveController", "DriveLimits", "Odometer", "limited"]


@dataclass(frozen=True)
class DriveLimits:
    """What the robot may be told.

    Attributes:
        speed_m_s: Along the floor, in any direction.
        turn_rad_s: Rate of turn.
        acceleration_m_s2: Of the speed along the floor; stopping obeys it too.
        turn_acceleration_rad_s2: Of the rate of turn.
        command_timeout_s: A command holds no longer; then the robot stops.

    Raises:
        ConfigError: One of them is not a positive number.
    """

    speed_m_s: float = 1.0
    turn_rad_s: float = 3.0
    acceleration_m_s2: float = 2.5
    turn_acceleration_rad_s2: float = 10.0
    command_timeout_s: float = 0.5

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not (math.isfinite(value) and value > 0):
                raise ConfigError(f"{item.name} must be a positive number, not {value!r}")


def _shortened(x: float, y: float, limit: float) -> tuple[float, float]:
    length = math.hypot(x, y)
    return (x, y) if length <= limit else (x * limit / length, y * limit / length)


def _within(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))


def limited(wanted: BodySpeed, now: BodySpeed, dt_s: float, limits: DriveLimits) -> BodySpeed:
    """The speed to command next: towards ``wanted`` as fast as allowed, its direction kept."""
    vx, vy = _shortened(wanted.vx, wanted.vy, limits.speed_m_s)
    step = _shortened(vx - now.vx, vy - now.vy, limits.acceleration_m_s2 * dt_s)
    turn = _within(wanted.wz, limits.turn_rad_s) - now.wz
    turn_step = _within(turn, limits.turn_acceleration_rad_s2 * dt_s)
    return BodySpeed(now.vx + step[0], now.vy + step[1], now.wz + turn_step)


class DriveController:
    """Turns commands into wheel speeds. Times are seconds of any monotonic clock.

    Args:
        drive: Its measures.
        limits: What it may do.
    """

    def __init__(self, drive: Mecanum, limits: DriveLimits | None = None) -> None:
        self.drive = drive
        self.limits = limits or DriveLimits()
        self.speed = BodySpeed()
        self._wanted = BodySpeed()
        self._commanded_at = -math.inf

    def command(self, wanted: BodySpeed, now: float) -> bool:
        """What somebody wants; False if it is no speed (NaN, infinite) and was refused."""
        if not all(math.isfinite(part) for part in wanted):
            return False
        self._wanted = wanted
        self._commanded_at = now
        return True

    def is_commanded(self, now: float) -> bool:
        """Whether the last command still holds."""
        return now - self._commanded_at <= self.limits.command_timeout_s

    def update(self, now: float, dt_s: float) -> WheelSpeeds:
        """Wheel speeds for the next period of ``dt_s``."""
        wanted = self._wanted if self.is_commanded(now) else BodySpeed()
        self.speed = limited(wanted, self.speed, dt_s, self.limits)
        return self.drive.wheels(self.speed)

    def stop(self) -> None:
        """Stand still at once and forget the command: the wheels are not ours any more."""
        self.speed = self._wanted = BodySpeed()
        self._commanded_at = -math.inf


@dataclass
class Odometer:
    """Where the robot is, from its wheels.

    The variances grow with the way, however often it is looked at.

    Attributes:
        drive: Its measures.
        pose: Since it was switched on.
        speed: As the wheels turn.
        slip: Standard deviation of what slip makes of a way of 1 m, m; of a turn of 1 rad, rad. Of a speed, as
            a share of it.
    """

    drive: Mecanum
    pose: Pose = field(default_factory=Pose)
    speed: BodySpeed = field(default_factory=BodySpeed)
    slip: float = 0.03
    way_variance_m2: float = 0.0
    turn_variance_rad2: float = 0.0
    _angles: tuple[float, ...] | None = None

    def update(self, angles: tuple[float, ...], speeds: WheelSpeeds) -> None:
        """The wheels stand at these angles now, rad, and turn so.

        Differences of angles count, so that no way is lost when some samples are.
        """
        self.speed = self.drive.body(speeds)
        before, self._angles = self._angles, angles
        if before is None:
            return
        turned = [new - old for new, old in zip(angles, before, strict=True)]
        way = self.drive.body(WheelSpeeds(*turned))
        self.pose = integrated(self.pose, way, 1.0)
        self.way_variance_m2 += self.slip**2 * math.hypot(way.vx, way.vy)
        self.turn_variance_rad2 += self.slip**2 * abs(way.wz)

    def restart(self) -> None:
        """The wheels may have turned unseen: go on from the next angles, the pose kept."""
        self._angles = None
        self.speed = BodySpeed()

    def pose_covariance(self) -> list[float]:
        """36 numbers for x, y, z, roll, pitch, yaw; what a flat floor fixes is small."""
        spread, turn = self.way_variance_m2 + 1e-6, self.turn_variance_rad2 + 1e-6
        return _diagonal(spread, spread, 1e-6, 1e-6, 1e-6, turn)

    def speed_covariance(self) -> list[float]:
        """36 numbers for the speeds."""
        way = (self.slip * math.hypot(self.speed.vx, self.speed.vy)) ** 2 + 1e-6
        turn = (self.slip * self.speed.wz) ** 2 + 1e-6
        return _diagonal(way, way, 1e-6, 1e-6, 1e-6, turn)


def _diagonal(*values: float) -> list[float]:
    matrix = [0.0] * 36
    for index, value in enumerate(values):
        matrix[index * 7] = value
    return matrix
