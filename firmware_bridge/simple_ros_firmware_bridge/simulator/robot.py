"""The physics of a simulated robot_xl: four motors, a body, sensors with noise. Time is an argument."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from random import Random

from simple_ros_firmware_bridge.mecanum import (
    BodySpeed,
    Mecanum,
    Pose,
    WheelSpeeds,
    integrated,
)

__all__ = ["GRAVITY", "Robot"]

GRAVITY = 9.80665
_MOTOR_S = 0.05
_MAX_WHEEL = 40.0
_COMMAND_TIMEOUT_S = 0.5
_GYRO_NOISE = 0.002
_ACCEL_NOISE = 0.02
_WALL_M = 2.0


@dataclass
class Robot:
    """A robot in a square room of 4 m.

    Attributes:
        random: For noise.
        drive: Its measures.
        pose: Where it really is.
        body: How it really moves.
        angles: Of the wheels, rad, as encoders count them.
        wheels: Their speeds.
    """

    random: Random
    drive: Mecanum = field(default_factory=lambda: Mecanum(0.04, 0.2))
    pose: Pose = field(default_factory=Pose)
    body: BodySpeed = field(default_factory=BodySpeed)
    angles: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    wheels: WheelSpeeds = field(default_factory=WheelSpeeds)
    acceleration: tuple[float, float] = (0.0, 0.0)
    _command: BodySpeed = field(default_factory=BodySpeed)
    _commanded_at: float = -math.inf

    def command(self, body: BodySpeed, now: float) -> None:
        """What it is to do for half a second, or until the next command."""
        self._command = body
        self._commanded_at = now

    def step(self, now: float, dt_s: float) -> None:
        """Let time pass: motors follow their commands as a first-order lag of 50 ms."""
        fresh = now - self._commanded_at <= _COMMAND_TIMEOUT_S
        wanted = self.drive.wheels(self._command if fresh else BodySpeed())
        share = 1 - math.exp(-dt_s / _MOTOR_S)
        self.wheels = WheelSpeeds(
            *(
                have + share * (max(-_MAX_WHEEL, min(_MAX_WHEEL, want)) - have)
                for have, want in zip(self.wheels, wanted, strict=True)
            )
        )
        before, self.body = self.body, self.drive.body(self.wheels)
        self.acceleration = (
            (self.body.vx - before.vx) / dt_s,
            (self.body.vy - before.vy) / dt_s,
        )
        self.angles = tuple(
            angle + speed * dt_s for angle, speed in zip(self.angles, self.wheels, strict=True)
        )
        self.pose = integrated(self.pose, self.body, dt_s)

    def gyro(self) -> tuple[float, float, float]:
        """Angular velocity as measured, rad/s."""
        noise = self.random.gauss
        return noise(0, _GYRO_NOISE), noise(0, _GYRO_NOISE), self.body.wz + noise(0, _GYRO_NOISE)

    def accelerometer(self) -> tuple[float, float, float]:
        """Acceleration as measured, m/s^2, gravity included."""
        noise = self.random.gauss
        ax, ay = self.acceleration
        return (
            ax + noise(0, _ACCEL_NOISE),
            ay + noise(0, _ACCEL_NOISE),
            GRAVITY + noise(0, _ACCEL_NOISE),
        )

    def distance_ahead(self) -> float:
        """From its centre to the wall in front of it, m."""
        cos, sin = math.cos(self.pose.yaw), math.sin(self.pose.yaw)
        ways = [
            (math.copysign(_WALL_M, part) - at) / part
            for part, at in ((cos, self.pose.x), (sin, self.pose.y))
            if abs(part) > 1e-9
        ]
        return max(0.0, min(ways))
