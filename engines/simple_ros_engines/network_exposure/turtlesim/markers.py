"""The turtles and their lines as markers, for the 3D panel of Foxglove. Pure."""

from __future__ import annotations

import math
from itertools import pairwise

from simple_ros.msg.geometry_msgs import Point
from simple_ros.msg.visualization_msgs import (
    ADD,
    ARROW,
    CUBE,
    DELETEALL,
    LINE_LIST,
    ColorRGBA,
    Marker,
    MarkerArray,
)
from simple_ros_engines.network_exposure.turtlesim.world import SIDE_M, Stroke, Turtle, World

__all__ = ["COLOURS", "markers"]

COLOURS = ((0.30, 0.75, 0.35), (0.95, 0.55, 0.20), (0.85, 0.35, 0.60), (0.95, 0.85, 0.30))
"""Of the turtles, in turn."""
_LENGTH_M = 0.6
_PIXEL_M = 1 / 45
FRAME = "world"


def markers(world: World, background: tuple[int, int, int]) -> MarkerArray:
    """The whole picture."""
    array = MarkerArray()
    array.markers.add(action=DELETEALL).header.frame_id = FRAME
    ground = array.markers.add(ns="ground", action=ADD, type=CUBE)
    ground.header.frame_id = FRAME
    ground.pose.position.x = ground.pose.position.y = SIDE_M / 2
    ground.pose.position.z = -0.05
    ground.pose.orientation.w = 1.0
    ground.scale.x = ground.scale.y = SIDE_M
    ground.scale.z = 0.02
    ground.color.CopyFrom(_colour(*background))
    for number, turtle in enumerate(world.turtles.values()):
        array.markers.append(_arrow(turtle, number))
        if turtle.strokes:
            array.markers.append(_line(turtle))
    return array


def _arrow(turtle: Turtle, number: int) -> Marker:
    marker = Marker(ns=turtle.name, id=0, action=ADD, type=ARROW)
    marker.header.frame_id = FRAME
    marker.pose.position.x = turtle.x - _LENGTH_M / 2 * math.cos(turtle.theta)
    marker.pose.position.y = turtle.y - _LENGTH_M / 2 * math.sin(turtle.theta)
    marker.pose.orientation.z = math.sin(turtle.theta / 2)
    marker.pose.orientation.w = math.cos(turtle.theta / 2)
    marker.scale.x, marker.scale.y, marker.scale.z = _LENGTH_M, 0.25, 0.25
    r, g, b = COLOURS[number % len(COLOURS)]
    marker.color.CopyFrom(ColorRGBA(r=r, g=g, b=b, a=1.0))
    return marker


def _line(turtle: Turtle) -> Marker:
    marker = Marker(ns=turtle.name, id=1, action=ADD, type=LINE_LIST)
    marker.header.frame_id = FRAME
    marker.pose.orientation.w = 1.0
    marker.scale.x = _PIXEL_M * turtle.pen.width
    strokes = list(turtle.strokes)
    for stroke in strokes:
        marker.points.extend(Point(x=x, y=y) for x, y in (stroke.start, stroke.end))
    if _is_coloured(strokes):
        for stroke in strokes:
            marker.colors.extend([_colour(stroke.pen.r, stroke.pen.g, stroke.pen.b)] * 2)
    else:
        pen = strokes[0].pen
        marker.color.CopyFrom(_colour(pen.r, pen.g, pen.b))
    return marker


def _is_coloured(strokes: list[Stroke]) -> bool:
    colours = ((s.pen.r, s.pen.g, s.pen.b) for s in strokes)
    return any(one != other for one, other in pairwise(colours))


def _colour(r: int, g: int, b: int) -> ColorRGBA:
    return ColorRGBA(r=r / 255, g=g / 255, b=b / 255, a=1.0)
