"""The shapes of a marker as primitives of a scene entity. Pure."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.ModelPrimitive_pb2 import ModelPrimitive
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
from foxglove_schemas_protobuf.TextPrimitive_pb2 import TextPrimitive
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3

from simple_ros.foxglove.convert.arrows import HEAD_SHARE, add_arrows
from simple_ros.foxglove.convert.common import color, placed, placement, vector
from simple_ros.foxglove.convert.records import MARKS, Floats, Records, columns
from simple_ros.msg import visualization_msgs as vis
from simple_ros.msg.visualization_msgs import Marker
from simple_ros.tf.rigid import Rigid

__all__ = ["Vertices", "add_shapes", "is_finite", "line_primitive", "moved", "vertices_of"]

_POSE = Pose(
    position=Vector3(x=MARKS[0], y=MARKS[1], z=MARKS[2]),
    orientation=Quaternion(x=MARKS[3], y=MARKS[4], z=MARKS[5], w=MARKS[6]),
)
_SIZE = Vector3(x=MARKS[7], y=MARKS[8], z=MARKS[9])
_CUBES = Records(
    8,
    CubePrimitive(
        pose=_POSE,
        size=_SIZE,
        color=Color(r=MARKS[10], g=MARKS[11], b=MARKS[12], a=MARKS[13]),
    ),
)
_SPHERES = Records(
    9,
    SpherePrimitive(
        pose=_POSE,
        size=_SIZE,
        color=Color(r=MARKS[10], g=MARKS[11], b=MARKS[12], a=MARKS[13]),
    ),
)
_POINT = Point3(x=MARKS[0], y=MARKS[1], z=MARKS[2])
_COLOR = Color(r=MARKS[0], g=MARKS[1], b=MARKS[2], a=MARKS[3])
_LINE_POINTS, _LINE_COLORS = Records(5, _POINT), Records(7, _COLOR)
_TRIANGLE_POINTS, _TRIANGLE_COLORS = Records(2, _POINT), Records(4, _COLOR)

_MEDIA_TYPES = {
    "dae": "model/vnd.collada+xml",
    "glb": "model/gltf-binary",
    "gltf": "model/gltf+json",
    "obj": "model/obj",
    "stl": "model/stl",
}


@dataclass(frozen=True, slots=True)
class Vertices:
    """The points of a marker.

    Attributes:
        points: Shape (count, 3).
        colors: Shape (count, 4), or None if all have the colour of the marker.
    """

    points: Floats
    colors: Floats | None


def add_shapes(marker: Marker, entity: SceneEntity) -> None:
    """Add what a marker looks like; nothing if its type is unknown or a number is not finite."""
    draw = _DRAWERS.get(marker.type)
    if draw is not None and is_finite(marker):
        draw(marker, entity)


def vertices_of(marker: Marker, group: int = 1) -> Vertices:
    """The points of a marker, by groups of lines or triangles.

    Groups with a number that is not finite are left out, and so is what fills no group. Colours count
    if there is one per point, or one per group.
    """
    count = len(marker.points) // group * group
    points = columns(marker.points, len(marker.points), "x", "y", "z")[:count]
    colors = None
    if marker.colors:
        given = columns(marker.colors, len(marker.colors), "r", "g", "b", "a")
        if len(given) == len(marker.points):
            colors = given[:count]
        elif len(given) * group == count:
            colors = np.repeat(given, group, axis=0)
    good = np.isfinite(points).reshape(-1, 3 * group).all(axis=1).repeat(group)
    if good.all():
        return Vertices(points, colors)
    return Vertices(points[good], None if colors is None else colors[good])


def line_primitive(
    kind: LinePrimitive.Type.ValueType, marker: Marker, at: Vertices
) -> LinePrimitive:
    """A line of the width and colour of a marker, not placed yet."""
    line = LinePrimitive(type=kind, thickness=marker.scale.x, color=color(marker.color))
    line.MergeFromString(_LINE_POINTS.serialised(at.points))
    if at.colors is not None:
        line.MergeFromString(_LINE_COLORS.serialised(at.colors))
    return line


# -- one of each -----------------------------------------------------------------------------------


def _cube(marker: Marker, entity: SceneEntity) -> None:
    pose, size = placed(marker.pose), vector(marker.scale)
    entity.cubes.add(pose=pose, size=size, color=color(marker.color))


def _sphere(marker: Marker, entity: SceneEntity) -> None:
    pose, size = placed(marker.pose), vector(marker.scale)
    entity.spheres.add(pose=pose, size=size, color=color(marker.color))


def _cylinder(marker: Marker, entity: SceneEntity) -> None:
    cylinder = CylinderPrimitive(bottom_scale=1.0, top_scale=1.0, color=color(marker.color))
    cylinder.pose.CopyFrom(placed(marker.pose))
    cylinder.size.CopyFrom(vector(marker.scale))
    entity.cylinders.append(cylinder)


def _text(marker: Marker, entity: SceneEntity) -> None:
    text = TextPrimitive(billboard=True, font_size=marker.scale.z, text=marker.text)
    text.pose.CopyFrom(placed(marker.pose))
    text.color.CopyFrom(color(marker.color))
    entity.texts.append(text)


def _mesh(marker: Marker, entity: SceneEntity) -> None:
    model = ModelPrimitive(color=color(marker.color))
    model.pose.CopyFrom(placed(marker.pose))
    model.scale.CopyFrom(vector(marker.scale))
    model.override_color = not marker.mesh_use_embedded_materials
    if marker.mesh_file.data:
        ending = marker.mesh_file.filename.rpartition(".")[2].lower()
        model.media_type = _MEDIA_TYPES.get(ending, "")
        model.data = marker.mesh_file.data
    else:
        model.url = marker.mesh_resource
    entity.models.append(model)


# -- many ------------------------------------------------------------------------------------------


def _line(kind: LinePrimitive.Type.ValueType, group: int) -> Callable[[Marker, SceneEntity], None]:
    def draw(marker: Marker, entity: SceneEntity) -> None:
        line = line_primitive(kind, marker, vertices_of(marker, group))
        line.pose.CopyFrom(placed(marker.pose))
        entity.lines.append(line)

    return draw


def _triangles(marker: Marker, entity: SceneEntity) -> None:
    at = vertices_of(marker, 3)
    scale = np.array([marker.scale.x, marker.scale.y, marker.scale.z])
    if not scale.any():
        # Points are in m already, and nobody wants to see nothing: a scale never set is none.
        scale += 1
    triangles = TriangleListPrimitive(pose=placed(marker.pose), color=color(marker.color))
    triangles.MergeFromString(_TRIANGLE_POINTS.serialised(at.points * scale))
    if at.colors is not None:
        triangles.MergeFromString(_TRIANGLE_COLORS.serialised(at.colors))
    entity.triangles.append(triangles)


def _cubes(marker: Marker, entity: SceneEntity) -> None:
    scale = marker.scale
    _add_bodies(_CUBES, marker, (scale.x, scale.y, scale.z), entity)


def _spheres(marker: Marker, entity: SceneEntity) -> None:
    scale = marker.scale
    _add_bodies(_SPHERES, marker, (scale.x, scale.y, scale.z), entity)


def _points(marker: Marker, entity: SceneEntity) -> None:
    """As small cubes, since a scene knows no flat points; they are as deep as wide."""
    _add_bodies(_CUBES, marker, (marker.scale.x, marker.scale.y, marker.scale.x), entity)


def _add_bodies(
    kind: Records, marker: Marker, size: tuple[float, float, float], entity: SceneEntity
) -> None:
    at = vertices_of(marker)
    place = placement(marker.pose)
    rows = np.empty((len(at.points), 14))
    rows[:, 0:3] = moved(at.points, place)
    rows[:, 3:7] = place.rotation
    rows[:, 7:10] = size
    rows[:, 10:14] = _rgba(marker) if at.colors is None else at.colors
    entity.MergeFromString(kind.serialised(rows))


def _arrow(marker: Marker, entity: SceneEntity) -> None:
    """From the first point to the second; without points along x of the pose, as long as scale.x."""
    if len(marker.points) >= 2:
        _add_arrows(marker, vertices_of(marker).points[:2], entity)
        return
    length, thickness = marker.scale.x, marker.scale.y
    entity.arrows.add(
        pose=placed(marker.pose),
        shaft_length=(1 - HEAD_SHARE) * length,
        shaft_diameter=thickness,
        head_length=HEAD_SHARE * length,
        head_diameter=2 * thickness,
        color=color(marker.color),
    )


def _arrows(marker: Marker, entity: SceneEntity) -> None:
    _add_arrows(marker, vertices_of(marker).points, entity)


def _add_arrows(marker: Marker, points: Floats, entity: SceneEntity) -> None:
    """From each point to the next; scale is the diameter of shafts and heads and length of heads."""
    scale = marker.scale
    at = moved(points, placement(marker.pose))
    add_arrows(entity, at[:-1], at[1:], (scale.x, scale.y, scale.z), _rgba(marker))


def moved(points: Floats, place: Rigid) -> Floats:
    """Points of shape (count, 3) in the frame that a pose is given in."""
    result: Floats = points @ place.rotation_matrix().T + np.array(place.translation)
    return result


def _rgba(marker: Marker) -> tuple[float, float, float, float]:
    value = marker.color
    return (value.r, value.g, value.b, value.a)


def is_finite(marker: Marker) -> bool:
    """Whether place and size of a marker are numbers."""
    p, q, s = marker.pose.position, marker.pose.orientation, marker.scale
    return all(map(math.isfinite, (p.x, p.y, p.z, q.x, q.y, q.z, q.w, s.x, s.y, s.z)))


_DRAWERS: Mapping[int, Callable[[Marker, SceneEntity], None]] = {
    vis.CUBE: _cube,
    vis.SPHERE: _sphere,
    vis.CYLINDER: _cylinder,
    vis.ARROW: _arrow,
    vis.LINE_STRIP: _line(LinePrimitive.LINE_STRIP, 1),
    vis.POINTS: _points,
    vis.TEXT_VIEW_FACING: _text,
    vis.MESH_RESOURCE: _mesh,
    vis.LINE_LIST: _line(LinePrimitive.LINE_LIST, 2),
    vis.CUBE_LIST: _cubes,
    vis.SPHERE_LIST: _spheres,
    vis.TRIANGLE_LIST: _triangles,
    vis.ARROW_STRIP: _arrows,
}
