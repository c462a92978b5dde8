"""Rotations and rigid transforms as tuples of floats.

A quaternion is ``(x, y, z, w)`` of length 1; q and -q are the same rotation. ``Rigid(t, q)`` maps
coordinates p to ``q p q* + t``: rotate first, then shift.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from simple_ros.msg.geometry_msgs import Pose, Transform

__all__ = [
    "IDENTITY",
    "Quaternion",
    "Rigid",
    "Vector",
    "conjugate",
    "from_message",
    "multiply",
    "normalised",
    "rotate",
    "slerp",
    "to_message",
]

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

_NEARLY_PARALLEL = 1.0 - 1e-9


def normalised(q: Quaternion) -> Quaternion:
    """The quaternion with length 1.

    Raises:
        ValueError: It has no length, or a part is not finite.
    """
    length = math.hypot(*q)
    if not (length > 0 and math.isfinite(length)):
        raise ValueError(f"{q} is no rotation")
    x, y, z, w = q
    return (x / length, y / length, z / length, w / length)


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """The rotation that does ``b`` first, then ``a`` (Hamilton's product)."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def conjugate(q: Quaternion) -> Quaternion:
    """The rotation back."""
    x, y, z, w = q
    return (-x, -y, -z, w)


def rotate(q: Quaternion, v: Vector) -> Vector:
    """A vector, turned: v + 2w (u x v) + 2 u x (u x v) with u the vector part."""
    x, y, z, w = q
    vx, vy, vz = v
    cx, cy, cz = 2 * (y * vz - z * vy), 2 * (z * vx - x * vz), 2 * (x * vy - y * vx)
    return (
        vx + w * cx + y * cz - z * cy,
        vy + w * cy + z * cx - x * cz,
        vz + w * cz + x * cy - y * cx,
    )


def slerp(a: Quaternion, b: Quaternion, share: float) -> Quaternion:
    """The rotation a share (0 to 1) of the way from ``a`` to ``b``, at even speed, the short way.

    K. Shoemake, Animating rotation with quaternion curves, SIGGRAPH 1985.
    """
    cosine = sum(p * q for p, q in zip(a, b, strict=True))
    sign = -1.0 if cosine < 0 else 1.0
    cosine *= sign
    if cosine > _NEARLY_PARALLEL:
        left, right = 1.0 - share, share
    else:
        angle = math.acos(cosine)
        left = math.sin((1.0 - share) * angle) / math.sin(angle)
        right = math.sin(share * angle) / math.sin(angle)
    right *= sign
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return normalised(
        (
            left * ax + right * bx,
            left * ay + right * by,
            left * az + right * bz,
            left * aw + right * bw,
        )
    )


class Rigid(NamedTuple):
    """A rotation, then a translation.

    Attributes:
        translation: In m.
        rotation: Unit quaternion.
    """

    translation: Vector
    rotation: Quaternion

    def after(self, first: Rigid) -> Rigid:
        """What maps as ``first``, then as this one."""
        return Rigid(
            self.apply(first.translation), normalised(multiply(self.rotation, first.rotation))
        )

    def inverse(self) -> Rigid:
        """What maps back."""
        back = conjugate(self.rotation)
        x, y, z = rotate(back, self.translation)
        return Rigid((-x, -y, -z), back)

    def apply(self, point: Vector) -> Vector:
        """Where a point goes."""
        x, y, z = rotate(self.rotation, point)
        tx, ty, tz = self.translation
        return (x + tx, y + ty, z + tz)

    def toward(self, other: Rigid, share: float) -> Rigid:
        """A share (0 to 1) of the way to another: straight, and turning evenly."""
        ax, ay, az = self.translation
        bx, by, bz = other.translation
        translation = (
            ax + (bx - ax) * share,
            ay + (by - ay) * share,
            az + (bz - az) * share,
        )
        return Rigid(translation, slerp(self.rotation, other.rotation, share))

    def rotation_matrix(self) -> NDArray[np.float64]:
        """The rotation as 3x3 matrix."""
        x, y, z, w = self.rotation
        return np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )

    def rpy(self) -> Vector:
        """Roll, pitch and yaw in rad: about the fixed axes x, then y, then z."""
        x, y, z, w = self.rotation
        roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
        pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))
        yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        return (roll, pitch, yaw)


IDENTITY = Rigid((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def from_message(message: Transform | Pose) -> Rigid:
    """The transform of a message; that of a pose maps coordinates of the body to its frame.

    Raises:
        ValueError: The rotation has no length, or a part is not finite.
    """
    if isinstance(message, Pose):
        p, r = message.position, message.orientation
        place = (p.x, p.y, p.z)
    else:
        t, r = message.translation, message.rotation
        place = (t.x, t.y, t.z)
    if not all(map(math.isfinite, place)):
        raise ValueError(f"{place} is no translation")
    return Rigid(place, normalised((r.x, r.y, r.z, r.w)))


def to_message(rigid: Rigid) -> Transform:
    """A transform as message."""
    message = Transform()
    translation, rotation = message.translation, message.rotation
    translation.x, translation.y, translation.z = rigid.translation
    rotation.x, rotation.y, rotation.z, rotation.w = rigid.rotation
    return message
