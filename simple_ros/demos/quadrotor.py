"""A quadrotor on a circle: its motion, attitude and turn rate as functions of time.

Where it is follows from the circle; how it leans follows from where it goes. A quadrotor is
*differentially flat* (Mellinger and Kumar, "Minimum snap trajectory generation and control for
quadrotors", ICRA 2011): its rotors push along one axis only, so that axis must point along the
acceleration it has plus the 9.81 m/s² that hold it up, and position and yaw over time give all the
rest. With

* ``t = a + g e_z`` the thrust per mass, ``z_b = t / |t|`` the body's up axis,
* ``x_c = (cos yaw, sin yaw, 0)`` the heading, ``l = cross(z_b, x_c)``, ``y_b = l / |l|`` the body's
  left axis and ``x_b = cross(y_b, z_b)`` its forward axis,

the body turns, in its own axes, at ``(-y_b·ż_b, x_b·ż_b, -x_b·ẏ_b)``, where ``ż_b`` follows from
the jerk and ``ẏ_b`` from it and the yaw rate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from simple_ros.msg.geometry_msgs import Odometry, Point, Pose
from simple_ros.msg.geometry_msgs import Quaternion as QuaternionMsg
from simple_ros.msg.geometry_msgs import Vector3 as Vector3Msg

__all__ = [
    "GRAVITY_M_S2",
    "Circle",
    "Motion",
    "QuadState",
    "Quaternion",
    "Vector",
    "euler_angles_rad",
    "motion_at",
    "odometry",
    "product",
    "rotated",
    "state_at",
    "state_of",
]

GRAVITY_M_S2 = 9.81

Vector = tuple[float, float, float]
"""x, y, z."""
Quaternion = tuple[float, float, float, float]
"""x, y, z, w; of unit length where it is an orientation."""


@dataclass(frozen=True, slots=True)
class Circle:
    """A level circle around the origin whose height swings."""

    radius_m: float = 2.0
    angular_speed_rad_s: float = 2.0
    height_m: float = 0.5
    swing_m: float = 0.2
    swing_angular_speed_rad_s: float = 0.5


@dataclass(frozen=True, slots=True)
class Motion:
    """Position and its derivatives at one moment, in the world frame."""

    position_m: Vector
    velocity_m_s: Vector
    acceleration_m_s2: Vector
    jerk_m_s3: Vector


@dataclass(frozen=True, slots=True)
class QuadState:
    """All a quadrotor does at one moment.

    Attributes:
        position_m: In the world frame.
        orientation: From body (x ahead, y left, z up) to world.
        velocity_m_s: In the world frame.
        angular_velocity_rad_s: In the body frame.
    """

    position_m: Vector
    orientation: Quaternion
    velocity_m_s: Vector
    angular_velocity_rad_s: Vector


def motion_at(t_s: float, circle: Circle | None = None) -> Motion:
    """The motion ``t_s`` seconds after the start."""
    circle = circle or Circle()
    r, w = circle.radius_m, circle.angular_speed_rad_s
    cos, sin = math.cos(w * t_s), math.sin(w * t_s)
    swing, v = circle.swing_m, circle.swing_angular_speed_rad_s
    cos_z, sin_z = math.cos(v * t_s), math.sin(v * t_s)
    return Motion(
        (r * cos, r * sin, circle.height_m + swing * sin_z),
        (-r * w * sin, r * w * cos, swing * v * cos_z),
        (-r * w**2 * cos, -r * w**2 * sin, -swing * v**2 * sin_z),
        (r * w**3 * sin, -r * w**3 * cos, -swing * v**3 * cos_z),
    )


def state_of(motion: Motion) -> QuadState:
    """Attitude and turn rate that a motion demands, facing where it flies.

    Raises:
        ZeroDivisionError: It has none: in free fall, or with no horizontal speed.
    """
    vx, vy, _ = motion.velocity_m_s
    ax, ay, az = motion.acceleration_m_s2
    yaw_rad = math.atan2(vy, vx)
    yaw_rate_rad_s = (vx * ay - vy * ax) / (vx**2 + vy**2)
    heading = (math.cos(yaw_rad), math.sin(yaw_rad), 0.0)
    heading_rate = (-yaw_rate_rad_s * heading[1], yaw_rate_rad_s * heading[0], 0.0)

    thrust = (ax, ay, az + GRAVITY_M_S2)
    z_b = _unit(thrust)
    left = _cross(z_b, heading)
    y_b = _unit(left)
    x_b = _cross(y_b, z_b)

    z_rate = _turning(motion.jerk_m_s3, z_b, _length(thrust))
    left_rate = _sum(_cross(z_rate, heading), _cross(z_b, heading_rate))
    y_rate = _turning(left_rate, y_b, _length(left))
    return QuadState(
        motion.position_m,
        _quaternion(x_b, y_b, z_b),
        motion.velocity_m_s,
        (-_dot(y_b, z_rate), _dot(x_b, z_rate), -_dot(x_b, y_rate)),
    )


def state_at(t_s: float, circle: Circle | None = None) -> QuadState:
    """The state ``t_s`` seconds after the start."""
    return state_of(motion_at(t_s, circle))


def odometry(state: QuadState) -> Odometry:
    """The message that tells a state."""
    x, y, z = state.position_m
    qx, qy, qz, qw = state.orientation
    vx, vy, vz = state.velocity_m_s
    wx, wy, wz = state.angular_velocity_rad_s
    return Odometry(
        pose=Pose(position=Point(x=x, y=y, z=z), orientation=QuaternionMsg(x=qx, y=qy, z=qz, w=qw)),
        linear_velocity=Vector3Msg(x=vx, y=vy, z=vz),
        angular_velocity=Vector3Msg(x=wx, y=wy, z=wz),
    )


# -- orientations ------------------------------------------------------------------------------


def euler_angles_rad(orientation: Quaternion) -> Vector:
    """Roll, pitch and yaw: the turns about the fixed x, y and z axes, in this order."""
    x, y, z, w = orientation
    return (
        math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x)))),
        math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
    )


def rotated(vector: Vector, orientation: Quaternion) -> Vector:
    """A vector given in a frame of that orientation, in the world frame."""
    axis, w = orientation[:3], orientation[3]
    twice = _scaled(_cross(axis, vector), 2.0)
    return _sum(_sum(vector, _scaled(twice, w)), _cross(axis, twice))


def product(first: Quaternion, second: Quaternion) -> Quaternion:
    """The orientation ``second``, given in a frame of orientation ``first``."""
    ax, ay, az, aw = first
    bx, by, bz, bw = second
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def _quaternion(x_b: Vector, y_b: Vector, z_b: Vector) -> Quaternion:
    """The orientation of a body with these axes.

    The squares of the four parts follow from the diagonal; the largest is taken from there and
    divides the others, which keeps them exact (Shepperd, J. Guidance and Control 1(3), 1978).
    """
    (a, d, g), (b, e, h), (c, f, i) = x_b, y_b, z_b
    # Each candidate is four times one part of the quaternion times the whole of it.
    candidates = (
        (1 + a - e - i, b + d, c + g, h - f),
        (b + d, 1 - a + e - i, f + h, c - g),
        (c + g, f + h, 1 - a - e + i, d - b),
        (h - f, c - g, d - b, 1 + a + e + i),
    )
    x, y, z, w = max(candidates, key=lambda q: math.hypot(*q))
    length = math.hypot(x, y, z, w)
    return (x / length, y / length, z / length, w / length)


# -- vectors -----------------------------------------------------------------------------------


def _turning(rate: Vector, unit: Vector, length: float) -> Vector:
    """How fast a direction changes, by the rate of the vector of that length behind it."""
    along = _dot(unit, rate)
    return _scaled(_sum(rate, _scaled(unit, -along)), 1 / length)


def _sum(a: Vector, b: Vector) -> Vector:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def _scaled(a: Vector, factor: float) -> Vector:
    return (a[0] * factor, a[1] * factor, a[2] * factor)


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def _length(a: Vector) -> float:
    return math.hypot(*a)


def _unit(a: Vector) -> Vector:
    return _scaled(a, 1 / _length(a))
