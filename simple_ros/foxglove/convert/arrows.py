"""Arrows of a scene entity, by where they begin and end. Pure."""

from __future__ import annotations

import numpy as np
from foxglove_schemas_protobuf.ArrowPrimitive_pb2 import ArrowPrimitive
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3

from simple_ros.foxglove.convert.records import MARKS, Floats, Records

__all__ = ["HEAD_SHARE", "add_arrows"]

HEAD_SHARE = 0.23
"""Of the length of an arrow, where the marker does not say; RViz draws so, and heads twice as
thick as shafts."""

_ARROWS = Records(
    7,
    ArrowPrimitive(
        pose=Pose(
            position=Vector3(x=MARKS[0], y=MARKS[1], z=MARKS[2]),
            orientation=Quaternion(x=MARKS[3], y=MARKS[4], z=MARKS[5], w=MARKS[6]),
        ),
        shaft_length=MARKS[7],
        shaft_diameter=MARKS[8],
        head_length=MARKS[9],
        head_diameter=MARKS[10],
        color=Color(r=MARKS[11], g=MARKS[12], b=MARKS[13], a=MARKS[14]),
    ),
)


def add_arrows(
    entity: SceneEntity,
    starts: Floats,
    ends: Floats,
    size: tuple[float, float, float],
    rgba: tuple[float, float, float, float],
) -> None:
    """Add arrows, one per row; those without a length are left out.

    Args:
        entity: What to add to.
        starts: Shape (count, 3), in the frame of the entity.
        ends: Likewise.
        size: Diameter of shaft and head, length of the head; 0 is a share of the length.
        rgba: Their colour.
    """
    ways = ends - starts
    lengths = np.sqrt((ways**2).sum(axis=1))
    real = lengths > 0
    starts, ways, lengths = starts[real], ways[real], lengths[real]
    heads = np.minimum(size[2] if size[2] > 0 else HEAD_SHARE * lengths, lengths)
    rows = np.empty((len(starts), 15))
    rows[:, 0:3] = starts
    rows[:, 3:7] = _turns_from_x(ways / lengths[:, np.newaxis])
    rows[:, 7] = lengths - heads
    rows[:, 8] = size[0]
    rows[:, 9] = heads
    rows[:, 10] = size[1]
    rows[:, 11:15] = rgba
    entity.MergeFromString(_ARROWS.serialised(rows))


def _turns_from_x(directions: Floats) -> Floats:
    """Rotations that turn the x axis into unit vectors the short way, shape (count, 4)."""
    x, y, z = directions.T
    turns = np.column_stack((np.zeros_like(x), -z, y, 1 + x))
    # Straight back, every axis is as good as another.
    turns[1 + x < 1e-12] = (0.0, 0.0, 1.0, 0.0)
    unit: Floats = turns / np.sqrt((turns**2).sum(axis=1, keepdims=True))
    return unit
