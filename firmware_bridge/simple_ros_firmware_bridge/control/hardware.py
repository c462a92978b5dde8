"""Hardware interfaces: what the controller reads of the robot and tells it.

Nothing here reads a clock or a socket. `read` refuses to give what is no longer true: a board that died with
its wheels turning must not look alive.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, field

from simple_ros.errors import SimpleRosError
from simple_ros.msg.sensor_msgs import Imu, JointState
from simple_ros_firmware_bridge.mecanum import BodySpeed, Mecanum, WheelSpeeds

__all__ = ["WHEEL_JOINTS", "HardwareError", "JointReading", "MockSystem", "RobotImu", "RobotSystem"]

logger = logging.getLogger(__name__)

WHEEL_JOINTS = (
    "front_left_wheel_joint",
    "front_right_wheel_joint",
    "rear_left_wheel_joint",
    "rear_right_wheel_joint",
)
_STALE_PERIODS = 5
_MAX_NAMES = 32


class HardwareError(SimpleRosError, RuntimeError):
    """The robot cannot be read now.

    Attributes:
        interface: Which interface.
        reason: Why.
    """

    def __init__(self, interface: str, reason: str) -> None:
        self.interface = interface
        self.reason = reason
        super().__init__(f"{interface}: {reason}")


@dataclass
class JointReading:
    """What the wheels did.

    Attributes:
        angles: rad, in the order of `WHEEL_JOINTS`.
        speeds: rad/s.
    """

    angles: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    speeds: WheelSpeeds = field(default_factory=WheelSpeeds)


class _Fresh:
    """When something came last, and whether that is recent enough."""

    def __init__(self, name: str, what: str, period_s: float) -> None:
        self._name = name
        self._what = what
        self._limit_s = _STALE_PERIODS * period_s
        self._came_at: float | None = None

    def came(self, now: float) -> None:
        self._came_at = now

    def forget(self) -> None:
        self._came_at = None

    def check(self, now: float) -> None:
        if self._came_at is None:
            raise HardwareError(self._name, f"no {self._what} received from the board")
        age = now - self._came_at
        if age > self._limit_s:
            raise HardwareError(
                self._name,
                f"the last {self._what} came {age * 1e3:.0f} ms ago ({self._limit_s * 1e3:.0f} ms "
                "is the limit)",
            )


class RobotSystem:
    """The four wheels. Times are seconds of any monotonic clock.

    Args:
        drive: Its measures.
        period_s: Between joint states; after five of them without any the board counts as dead.
    """

    name = "RobotSystem"
    lifecycle = "RobotSystem"

    def __init__(self, drive: Mecanum, period_s: float = 0.01) -> None:
        self.drive = drive
        self._reading = JointReading()
        self._fresh = _Fresh(self.name, "joint states", period_s)
        self._unknown: set[str] = set()

    def joint_states_came(self, message: JointState, now: float) -> None:
        """A message of the board. Joints that are none of ours are logged once and skipped."""
        angles = list(self._reading.angles)
        speeds = list(self._reading.speeds)
        found = 0
        for index, name in enumerate(message.name):
            if name not in WHEEL_JOINTS:
                self._skip(name)
                continue
            if index >= len(message.position) or index >= len(message.velocity):
                continue
            angle, speed = message.position[index], message.velocity[index]
            if math.isfinite(angle) and math.isfinite(speed):  # one NaN would stay in the odometry
                place = WHEEL_JOINTS.index(name)
                angles[place], speeds[place] = angle, speed
                found += 1
        self._reading = JointReading(tuple(angles), WheelSpeeds(*speeds))
        if found == len(WHEEL_JOINTS):
            self._fresh.came(now)

    def _skip(self, name: str) -> None:
        if name not in self._unknown and len(self._unknown) < _MAX_NAMES:
            self._unknown.add(name)
            logger.error("joint states with unknown joint %r; known: %s", name, WHEEL_JOINTS)

    def read(self, now: float) -> JointReading:
        """What the wheels did last.

        Raises:
            HardwareError: Nothing came, not of all wheels, or too long ago.
        """
        self._fresh.check(now)
        return self._reading

    def write(self, wheels: WheelSpeeds, now: float) -> BodySpeed:  # noqa: ARG002  (the mock's needs it)
        """What to tell the board, which is commanded by body speeds."""
        return self.drive.body(wheels)

    def reset(self) -> None:
        """Forget what came: the next `read` needs something new."""
        self._fresh.forget()


class MockSystem(RobotSystem):
    """Wheels that do at once what they are told. Only for development, and said loudly."""

    name = "MockSystem"

    def __init__(self, drive: Mecanum, period_s: float = 0.01) -> None:
        super().__init__(drive, period_s)
        self._turning = WheelSpeeds()
        self._angles: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
        self._at: float | None = None

    def read(self, now: float) -> JointReading:
        """As if the wheels had followed."""
        elapsed = 0.0 if self._at is None else now - self._at
        self._at = now
        self._angles = tuple(
            angle + speed * elapsed
            for angle, speed in zip(self._angles, self._turning, strict=True)
        )
        return JointReading(self._angles, self._turning)

    def write(self, wheels: WheelSpeeds, now: float) -> BodySpeed:
        """Take the command for the truth."""
        self.read(now)
        self._turning = wheels
        return super().write(wheels, now)


class RobotImu:
    """The IMU. Times are seconds of any monotonic clock.

    Args:
        period_s: Between its messages.
    """

    name = "RobotImuSensor"
    lifecycle = "RobotImuSensor"

    def __init__(self, period_s: float = 0.02) -> None:
        self._last: Imu | None = None
        self._fresh = _Fresh(self.name, "IMU data", period_s)

    def imu_came(self, message: Imu, now: float) -> None:
        """A message of the board."""
        self._last = message
        self._fresh.came(now)

    def read(self, now: float) -> Imu:
        """The last measurement.

        Raises:
            HardwareError: Nothing came, or too long ago.
        """
        self._fresh.check(now)
        assert self._last is not None
        return self._last

    def reset(self) -> None:
        """Forget what came."""
        self._fresh.forget()
