"""A drive with four mecanum wheels, rollers at 45 degrees, in X arrangement seen from above.

With wheel radius ``r`` and ``L`` = half the wheelbase + half the track (the lever of a wheel's traction
about the centre), for body speeds ``vx`` forward, ``vy`` to the left, ``w`` counter-clockwise::

    fl = (vx - vy - w L) / r        vx = (fl + fr + rl + rr) r / 4
    fr = (vx + vy + w L) / r        vy = (-fl + fr + rl - rr) r / 4
    rl = (vx + vy - w L) / r        w  = (-fl + fr - rl + rr) r / (4 L)
    rr = (vx - vy + w L) / r

Source: P. Muir and C. Neuman, "Kinematic modeling for feedback control of an omnidirectional wheeled mobile
robot" (1987).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from simple_ros.errors import ConfigError

__all__ = ["BodySpeed", "Mecanum", "Pose", "WheelSpeeds", "integrated"]


class BodySpeed(NamedTuple):
    """Speed of the robot in its own frame.

    Attributes:
        vx: Forward, m/s.
        vy: To the left, m/s.
        wz: Counter-clockwise, rad/s.
    """

    vx: float = 0.0
    vy: float = 0.0
    wz: float = 0.0


class WheelSpeeds(NamedTuple):
    """Speeds of the wheels, rad/s, forward positive."""

    front_left: float = 0.0
    front_right: float = 0.0
    rear_left: float = 0.0
    rear_right: float = 0.0


class Pose(NamedTuple):
    """Where the robot is, in the frame in which it started: m, m, rad within -pi..pi."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0


@dataclass(frozen=True)
class Mecanum:
    """Measures of a drive.

    Attributes:
        wheel_radius_m: Radius of a wheel.
        lever_m: Half the wheelbase plus half the track.

    Raises:
        ConfigError: One of them is not a positive number.
    """

    wheel_radius_m: float
    lever_m: float

    def __post_init__(self) -> None:
        for name in ("wheel_radius_m", "lever_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ConfigError(f"{name} must be a positive number of metres, not {value!r}")

    def wheels(self, body: BodySpeed) -> WheelSpeeds:
        """What the wheels do when the robot moves so."""
        r, turn = self.wheel_radius_m, body.wz * self.lever_m
        return WheelSpeeds(
            (body.vx - body.vy - turn) / r,
            (body.vx + body.vy + turn) / r,
            (body.vx + body.vy - turn) / r,
            (body.vx - body.vy + turn) / r,
        )

    def body(self, wheels: WheelSpeeds) -> BodySpeed:
        """How the robot moves when the wheels turn so; slip is what these four do not agree on."""
        fl, fr, rl, rr = wheels
        quarter = self.wheel_radius_m / 4
        return BodySpeed(
            (fl + fr + rl + rr) * quarter,
            (-fl + fr + rl - rr) * quarter,
            (-fl + fr - rl + rr) * quarter / self.lever_m,
        )


def integrated(pose: Pose, body: BodySpeed, dt_s: float) -> Pose:
    """Where the robot is ``dt_s`` later, if its speeds are constant: exact, along an arc."""
    turn = body.wz * dt_s
    if abs(turn) < 1e-6:
        along, across = dt_s * (1 - turn * turn / 6), dt_s * turn / 2
    else:
        along, across = math.sin(turn) / body.wz, (1 - math.cos(turn)) / body.wz
    dx = body.vx * along - body.vy * across
    dy = body.vx * across + body.vy * along
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    return Pose(
        pose.x + cos * dx - sin * dy,
        pose.y + sin * dx + cos * dy,
        math.remainder(pose.yaw + turn, 2 * math.pi),
    )
