"""Transforms, poses, paths and areas."""

from __future__ import annotations

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose as FoxglovePose
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3

from simple_ros.foxglove.convert.base import Context
from simple_ros.foxglove.convert.common import (
    frame_name,
    frame_of,
    oriented,
    placed,
    stamp_of,
    vector,
)
from simple_ros.foxglove.convert.records import MARKS, Floats, Records, columns
from simple_ros.msg import geometry_msgs as geo
from simple_ros.msg import nav_msgs as nav
from simple_ros.msg import ustc
from simple_ros.msg.std_msgs import Header
from simple_ros.msg.tf2_msgs import TFMessage

__all__ = [
    "bare_pose",
    "covered_pose",
    "flat_odometry",
    "odometry",
    "path_line",
    "path_poses",
    "polygon",
    "pose_array",
    "stamped_pose",
    "transform",
    "transforms",
]

PATH_WIDTH_M = 0.05
PATH_COLOR = Color(r=0.1, g=0.8, b=0.3, a=1.0)
AREA_COLOR = Color(r=0.95, g=0.65, b=0.1, a=1.0)

_POSES = Records(
    3,
    FoxglovePose(
        position=Vector3(x=MARKS[0], y=MARKS[1], z=MARKS[2]),
        orientation=Quaternion(x=MARKS[3], y=MARKS[4], z=MARKS[5], w=MARKS[6]),
    ),
)
_POSE_FIELDS = (
    *(f"position.{axis}" for axis in "xyz"),
    *(f"orientation.{axis}" for axis in "xyzw"),
)
_LINE_POINTS = Records(5, Point3(x=MARKS[0], y=MARKS[1], z=MARKS[2]))


def transforms(message: TFMessage, context: Context) -> FrameTransforms:
    """Edges of the frame tree."""
    edges = (_edge(edge, context) for edge in message.transforms)
    return FrameTransforms(transforms=edges)


def transform(message: geo.TransformStamped, context: Context) -> FrameTransforms:
    """One edge of the frame tree."""
    return FrameTransforms(transforms=[_edge(message, context)])


def _edge(message: geo.TransformStamped, context: Context) -> FrameTransform:
    return FrameTransform(
        timestamp=stamp_of(message.header, context),
        parent_frame_id=frame_of(message.header, context),
        child_frame_id=frame_name(message.child_frame_id),
        translation=vector(message.transform.translation),
        rotation=oriented(message.transform.rotation),
    )


# -- one pose --------------------------------------------------------------------------------------


def stamped_pose(message: geo.PoseStamped, context: Context) -> PoseInFrame:
    """A pose."""
    return _pose_in_frame(message.header, message.pose, context)


def covered_pose(message: geo.PoseWithCovarianceStamped, context: Context) -> PoseInFrame:
    """A pose; how far it can be trusted is not shown."""
    return _pose_in_frame(message.header, message.pose.pose, context)


def odometry(message: nav.Odometry, context: Context) -> PoseInFrame:
    """The pose in odometry."""
    return _pose_in_frame(message.header, message.pose.pose, context)


def flat_odometry(message: geo.Odometry, context: Context) -> PoseInFrame:
    """The pose in odometry of C++ simple_ros, which names no frame and no time."""
    return _pose_in_frame(Header(), message.pose, context)


def bare_pose(message: ustc.Pose, context: Context) -> PoseInFrame:
    """A place in the form of C++ simple_ros, which has no orientation, frame or time."""
    position = geo.Point(x=message.x, y=message.y, z=message.z)
    return _pose_in_frame(Header(), geo.Pose(position=position), context)


def _pose_in_frame(header: Header, pose: geo.Pose, context: Context) -> PoseInFrame:
    return PoseInFrame(
        timestamp=stamp_of(header, context),
        frame_id=frame_of(header, context),
        pose=placed(pose),
    )


# -- many ------------------------------------------------------------------------------------------


def pose_array(message: geo.PoseArray, context: Context) -> PosesInFrame:
    """Poses in one frame."""
    values = columns(message.poses, len(message.poses), *_POSE_FIELDS)
    return _poses_in_frame(message.header, values, context)


def path_poses(message: nav.Path, context: Context) -> PosesInFrame:
    """The poses of a path.

    Raises:
        ValueError: They are in several frames.
    """
    header = _path_header(message)
    fields = (f"pose.{field}" for field in _POSE_FIELDS)
    values = columns(message.poses, len(message.poses), *fields)
    return _poses_in_frame(header, values, context)


def path_line(message: nav.Path, context: Context) -> SceneUpdate:
    """A path as a line.

    Raises:
        ValueError: Its poses are in several frames.
    """
    header = _path_header(message)
    fields = (f"pose.position.{axis}" for axis in "xyz")
    points = columns(message.poses, len(message.poses), *fields)
    line = LinePrimitive(type=LinePrimitive.LINE_STRIP, thickness=PATH_WIDTH_M, color=PATH_COLOR)
    return _line_scene(header, "path", line, points, context)


def polygon(message: geo.PolygonStamped, context: Context) -> SceneUpdate:
    """The outline of an area."""
    points = columns(message.polygon.points, len(message.polygon.points), "x", "y", "z")
    line = LinePrimitive(type=LinePrimitive.LINE_LOOP, thickness=PATH_WIDTH_M, color=AREA_COLOR)
    return _line_scene(message.header, "polygon", line, points, context)


def _poses_in_frame(header: Header, values: Floats, context: Context) -> PosesInFrame:
    values[~values[:, 3:7].any(axis=1), 6] = 1.0
    message = PosesInFrame(timestamp=stamp_of(header, context), frame_id=frame_of(header, context))
    message.MergeFromString(_POSES.serialised(values))
    return message


def _line_scene(
    header: Header, name: str, line: LinePrimitive, points: Floats, context: Context
) -> SceneUpdate:
    """A line that replaces the one before; points with a number that is not finite are left out."""
    line.pose.orientation.w = 1.0
    line.MergeFromString(_LINE_POINTS.serialised(points[np.isfinite(points).all(axis=1)]))
    update = SceneUpdate()
    entity = update.entities.add(
        timestamp=stamp_of(header, context), frame_id=frame_of(header, context), id=name
    )
    entity.lifetime.SetInParent()
    entity.lines.append(line)
    return update


def _path_header(message: nav.Path) -> Header:
    """The header of a path; many programs name the frame in those of its poses only.

    Raises:
        ValueError: Its poses are in several frames.
    """
    frames = {frame_name(pose.header.frame_id) for pose in message.poses}
    frames -= {"", frame_name(message.header.frame_id)}
    if len(frames) == 1 and not frame_name(message.header.frame_id):
        return Header(stamp=message.header.stamp, frame_id=frames.pop())
    if frames:
        named = ", ".join(sorted(frames)[:3])
        raise ValueError(
            f"a path in the frame {message.header.frame_id!r} has poses in other frames: {named}"
        )
    return message.header
