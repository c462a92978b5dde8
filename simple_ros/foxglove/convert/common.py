"""Times, frames, poses and colours: the small parts of most messages."""

from __future__ import annotations

from typing import Protocol

from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.Pose_pb2 import Pose as FoxglovePose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion as FoxgloveQuaternion
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3 as FoxgloveVector3
from google.protobuf.timestamp_pb2 import Timestamp

from simple_ros.foxglove.convert.base import Context
from simple_ros.msg.geometry_msgs import Pose, Quaternion
from simple_ros.msg.std_msgs import Header
from simple_ros.msg.visualization_msgs import ColorRGBA
from simple_ros.tf.rigid import IDENTITY, Rigid, from_message

__all__ = [
    "color",
    "frame_name",
    "frame_of",
    "oriented",
    "placed",
    "placement",
    "pose_from",
    "stamp_of",
    "timestamp",
    "vector",
]

_NS = 1_000_000_000


class _Vector(Protocol):
    @property
    def x(self) -> float: ...
    @property
    def y(self) -> float: ...
    @property
    def z(self) -> float: ...


def timestamp(time_ns: int) -> Timestamp:
    """Nanoseconds since 1970 as message."""
    return Timestamp(seconds=time_ns // _NS, nanos=time_ns % _NS)


def stamp_of(header: Header, context: Context) -> Timestamp:
    """When something was measured, or received if that is not said."""
    stamp = header.stamp
    return stamp if stamp.seconds or stamp.nanos else timestamp(context.receive_time_ns)


def frame_of(header: Header, context: Context) -> str:
    """The frame something is given in, or the usual one."""
    return frame_name(header.frame_id) or context.frame_id


def frame_name(frame_id: str) -> str:
    """Without the slash of tf 1."""
    return frame_id.removeprefix("/")


def vector(value: _Vector) -> FoxgloveVector3:
    """A point or vector."""
    return FoxgloveVector3(x=value.x, y=value.y, z=value.z)


def oriented(q: Quaternion) -> FoxgloveQuaternion:
    """A rotation; one that was never set, and so is all zero, is none."""
    x, y, z, w = q.x, q.y, q.z, q.w
    return FoxgloveQuaternion(x=x, y=y, z=z, w=w if x or y or z or w else 1.0)


def placed(pose: Pose) -> FoxglovePose:
    """A pose, with `oriented`."""
    return FoxglovePose(position=vector(pose.position), orientation=oriented(pose.orientation))


def placement(pose: Pose) -> Rigid:
    """What maps coordinates in a pose to its frame; a rotation that was never set is none.

    Raises:
        ValueError: A part is not finite.
    """
    q, p = pose.orientation, pose.position
    if q.x or q.y or q.z or q.w:
        return from_message(pose)
    return Rigid((p.x, p.y, p.z), IDENTITY.rotation)


def pose_from(rigid: Rigid) -> FoxglovePose:
    """The pose that `placement` came from."""
    (tx, ty, tz), (x, y, z, w) = rigid
    return FoxglovePose(
        position=FoxgloveVector3(x=tx, y=ty, z=tz),
        orientation=FoxgloveQuaternion(x=x, y=y, z=z, w=w),
    )


def color(value: ColorRGBA) -> Color:
    """A colour, parts 0 to 1."""
    return Color(r=value.r, g=value.g, b=value.b, a=value.a)
