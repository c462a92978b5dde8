"""Whether a transform makes sense, and what is to be stored of it."""

from __future__ import annotations

import math

from simple_ros.msg.geometry_msgs import TransformStamped
from simple_ros.tf.cache import Entry
from simple_ros.tf.errors import InvalidArgument
from simple_ros.tf.rigid import Rigid, from_message
from simple_ros.time import Time

__all__ = ["checked"]

_UNIT_TOLERANCE = 0.01


def checked(transform: TransformStamped, authority: str = "") -> tuple[str, Entry]:
    """The child frame of a transform, and what is to be stored of it.

    Raises:
        InvalidArgument: It makes no sense, see `BufferCore.set_transform`.
    """
    parent, child = transform.header.frame_id.lstrip("/"), transform.child_frame_id.lstrip("/")
    _check_names(parent, child)
    return child, Entry(_stamp_of(transform), parent, _rigid_of(transform, child), authority)


def _check_names(parent: str, child: str) -> None:
    if not child:
        raise InvalidArgument(f"a transform in {parent!r} has no child_frame_id")
    if not parent:
        raise InvalidArgument(f"the transform of {child!r} has no header.frame_id")
    if parent == child:
        raise InvalidArgument(f"frame {child!r} cannot be its own parent")


def _stamp_of(transform: TransformStamped) -> int:
    try:
        return Time.from_msg(transform.header.stamp).nanoseconds
    except (ValueError, OverflowError) as error:
        raise InvalidArgument(f"the transform of {transform.child_frame_id!r}: {error}") from None


def _rigid_of(transform: TransformStamped, child: str) -> Rigid:
    rotation = transform.transform.rotation
    length = math.hypot(rotation.x, rotation.y, rotation.z, rotation.w)
    if not abs(length * length - 1.0) <= _UNIT_TOLERANCE:
        raise InvalidArgument(
            f"the rotation of {child!r} in {transform.header.frame_id!r} has length {length:.4g}; "
            "a rotation is a quaternion of length 1 (not turned: w = 1)"
        )
    try:
        return from_message(transform.transform)
    except ValueError as error:
        raise InvalidArgument(f"the transform of {child!r}: {error}") from None
