"""Samples as the firmware writes them: little endian, aligned from the first byte. Written out by hand."""

from __future__ import annotations

import struct
from collections.abc import Sequence

from simple_ros_firmware_bridge.mecanum import BodySpeed, Pose
from simple_ros_firmware_bridge.simulator.robot import Robot

__all__ = ["JOINTS", "illuminance", "imu", "joint_states", "odometry", "range_of", "twist"]

JOINTS = (
    "front_left_wheel_joint",
    "front_right_wheel_joint",
    "rear_left_wheel_joint",
    "rear_right_wheel_joint",
)


def _padded(data: bytes, size: int) -> bytes:
    return data + bytes(-len(data) % size)


def _string(before: bytes, text: str) -> bytes:
    content = text.encode() + b"\0"
    return _padded(before, 4) + struct.pack("<I", len(content)) + content


def _header(stamp_ns: int, frame: str) -> bytes:
    seconds, nanoseconds = divmod(stamp_ns, 10**9)
    return _string(struct.pack("<iI", seconds, nanoseconds), frame)


def _doubles(before: bytes, values: Sequence[float]) -> bytes:
    return _padded(before, 8) + struct.pack(f"<{len(values)}d", *values)


def _sequence(before: bytes, values: Sequence[float]) -> bytes:
    return _doubles(_padded(before, 4) + struct.pack("<I", len(values)), values)


def joint_states(robot: Robot, stamp_ns: int) -> bytes:
    """sensor_msgs/JointState."""
    data = _padded(_header(stamp_ns, ""), 4) + struct.pack("<I", len(JOINTS))
    for name in JOINTS:
        data = _string(data, name)
    data = _sequence(data, robot.angles)
    data = _sequence(data, robot.wheels)
    return _padded(data, 4) + struct.pack("<I", 0)


def imu(robot: Robot, stamp_ns: int) -> bytes:
    """sensor_msgs/Imu; the orientation is not measured, so its covariance begins with -1."""
    none = [0.0] * 9
    values = [
        0.0,
        0.0,
        0.0,
        1.0,
        -1.0,
        *none[1:],
        *robot.gyro(),
        *none,
        *robot.accelerometer(),
        *none,
    ]
    return _doubles(_header(stamp_ns, "imu_link"), values)


def odometry(pose: Pose, body: BodySpeed, stamp_ns: int) -> bytes:
    """nav_msgs/Odometry."""
    import math

    half = pose.yaw / 2
    covariance = [0.0] * 36
    values = [pose.x, pose.y, 0.0, 0.0, 0.0, math.sin(half), math.cos(half), *covariance]
    values += [body.vx, body.vy, 0.0, 0.0, 0.0, body.wz, *covariance]
    return _doubles(_string(_header(stamp_ns, "odom"), "base_link"), values)


def range_of(distance_m: float, stamp_ns: int, *, is_infrared: bool, has_variance: bool) -> bytes:
    """sensor_msgs/Range, as of Humble or with the member that came later."""
    frame, limit = ("range_tof", 0.255) if is_infrared else ("range_ultrasonic", 4.0)
    data = _padded(_header(stamp_ns, frame) + bytes((is_infrared,)), 4)
    numbers = [0.44, 0.02, limit, min(distance_m, limit)] + [0.0] * has_variance
    return data + struct.pack(f"<{len(numbers)}f", *numbers)


def illuminance(lux: float, stamp_ns: int) -> bytes:
    """sensor_msgs/Illuminance."""
    return _doubles(_header(stamp_ns, "range_tof"), [lux, 0.0])


def twist(data: bytes) -> BodySpeed:
    """Body speeds of a geometry_msgs/Twist."""
    vx, vy, _, _, _, wz = struct.unpack("<6d", data[:48])
    return BodySpeed(vx, vy, wz)
