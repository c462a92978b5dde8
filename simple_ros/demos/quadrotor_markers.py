"""What to draw of a quadrotor: shapes as functions of a pose, lines as functions of points.

Names, numbers, colours and sizes are those of the C++ quad_visualizer, whatever shows its topics
shows these. Three things differ for the eye: arms reach from the body to their propellers,
propellers are blades, and they turn.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from simple_ros.demos.quadrotor import Quaternion, Vector, product, rotated
from simple_ros.msg.geometry_msgs import Point, Pose, Vector3
from simple_ros.msg.geometry_msgs import Quaternion as QuaternionMsg
from simple_ros.msg.visualization_msgs import (
    ADD,
    CUBE,
    CYLINDER,
    LINE_STRIP,
    ColorRGBA,
    Marker,
    MarkerArray,
    MarkerType,
)

__all__ = [
    "PATH_POINTS",
    "propeller_angle_rad",
    "quadrotor_markers",
    "short_path_marker",
    "step_marker",
]

PATH_POINTS = 150
"""Most points of the short path."""

_NAMESPACE = "quadrotor"
_BODY_SIZE_M = (0.3, 0.3, 0.1)
_ARM_LENGTH_M = 0.3
_ARM_SIZE_M = (0.03, 0.03, _ARM_LENGTH_M)
_ARM_HEIGHT_M = 0.02
_PROPELLER_SIZE_M = (0.3, 0.04, 0.02)
_PROPELLER_HEIGHT_M = 0.04
_PROPELLER_SPEED_RAD_S = 12.0

_BLUE = (0.2, 0.2, 0.8)
_RED = (0.8, 0.2, 0.2)
_GREEN = (0.2, 0.8, 0.2)
_BRIGHT_RED = (1.0, 0.0, 0.0)
_BRIGHT_GREEN = (0.0, 1.0, 0.0)

_DIRECTIONS = ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))
"""Where the arms point: ahead, back, left, right. The first two propellers turn left."""
_LYING = math.sqrt(0.5)
_LYING_X: Quaternion = (0.0, _LYING, 0.0, _LYING)
_LYING_Y: Quaternion = (-_LYING, 0.0, 0.0, _LYING)
"""A cylinder stands along z; these lay it along x and y."""


def propeller_angle_rad(t_s: float) -> float:
    """How far the propellers have turned after ``t_s`` seconds, slow enough to be seen at 50 Hz."""
    return (_PROPELLER_SPEED_RAD_S * t_s) % (2 * math.pi)


def quadrotor_markers(pose: Pose, angle_rad: float = 0.0) -> MarkerArray:
    """Body (id 0), arms (1 to 4) and propellers (5 to 8).

    Args:
        pose: Of the body, in the world frame.
        angle_rad: How far the propellers have turned.
    """
    shapes = [_shape(CUBE, _BODY_SIZE_M, _BLUE, pose, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))]
    for x, y in _DIRECTIONS:
        middle = (x * _ARM_LENGTH_M / 2, y * _ARM_LENGTH_M / 2, _ARM_HEIGHT_M)
        shapes.append(
            _shape(CYLINDER, _ARM_SIZE_M, _RED, pose, middle, _LYING_X if x else _LYING_Y)
        )
    for x, y in _DIRECTIONS:
        hub = (x * _ARM_LENGTH_M, y * _ARM_LENGTH_M, _PROPELLER_HEIGHT_M)
        turn = _about_z(angle_rad if x else -angle_rad)
        shapes.append(_shape(CYLINDER, _PROPELLER_SIZE_M, _GREEN, pose, hub, turn))
    for number, shape in enumerate(shapes):
        shape.id = number
    return MarkerArray(markers=shapes)


def short_path_marker(points: Iterable[Point]) -> Marker:
    """The way of the last moments as one line."""
    return _line("quad_path_short", 0, points, 0.35, _BRIGHT_RED, lifetime=50.0)


def step_marker(before: Point, now: Point) -> Marker:
    """The newest step of a way that is never erased: viewers join the steps."""
    return _line("quad_path_incremental", 1, (before, now), 0.15, _BRIGHT_GREEN, lifetime=-1.0)


def _about_z(angle_rad: float) -> Quaternion:
    return (0.0, 0.0, math.sin(angle_rad / 2), math.cos(angle_rad / 2))


def _shape(
    kind: MarkerType.ValueType,
    size_m: Vector,
    color: Vector,
    body: Pose,
    offset_m: Vector,
    turn: Quaternion,
) -> Marker:
    """A shape fixed to the body at an offset, turned against it."""
    at, q = body.position, body.orientation
    orientation = (q.x, q.y, q.z, q.w)
    dx, dy, dz = rotated(offset_m, orientation)
    x, y, z, w = product(orientation, turn)
    return Marker(
        ns=_NAMESPACE,
        type=kind,
        action=ADD,
        pose=Pose(
            position=Point(x=at.x + dx, y=at.y + dy, z=at.z + dz),
            orientation=QuaternionMsg(x=x, y=y, z=z, w=w),
        ),
        scale=Vector3(x=size_m[0], y=size_m[1], z=size_m[2]),
        color=_color(color),
    )


def _line(
    name: str, number: int, points: Iterable[Point], width_m: float, color: Vector, lifetime: float
) -> Marker:
    return Marker(
        ns=name,
        id=number,
        type=LINE_STRIP,
        action=ADD,
        scale=Vector3(x=width_m),
        color=_color(color),
        lifetime=lifetime,
        points=points,
    )


def _color(color: Vector) -> ColorRGBA:
    red, green, blue = color
    return ColorRGBA(r=red, g=green, b=blue, a=1.0)
