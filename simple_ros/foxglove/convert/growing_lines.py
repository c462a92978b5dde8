"""Lines that grow by a step with each message. Pure.

The quadrotor of C++ simple_ros draws its way as LINE_STRIP markers with a negative lifetime and two
points, the last place and this one; who shows them must join them. So a LINE_STRIP with a negative
lifetime and at most two points (without any, the position of its pose) goes on where the line of its
ns and id ended. More points are the whole line, and begin it anew.

A line may become long and is shown to viewers that come at any time, so it is cut in *pieces*: the
newest is the entity of the marker, and in every update one of the older pieces, in turn, comes along.
An update stays small, and a new viewer sees everything after as many updates as there are pieces. Of
what is longer than `PIECES` times `PIECE_POINTS` points, the oldest piece goes.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field

import numpy as np
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive

from simple_ros.foxglove.convert.common import placement
from simple_ros.foxglove.convert.records import Floats
from simple_ros.foxglove.convert.shapes import Vertices, line_primitive, moved, vertices_of
from simple_ros.msg.visualization_msgs import LINE_STRIP, Marker

__all__ = ["PIECES", "PIECE_POINTS", "GrowingLines", "is_step"]

PIECE_POINTS = 200
PIECES = 50
MAX_LINES = 64
"""Lines remembered; the one that has not grown for longest is forgotten first."""

_STEP_POINTS = 2


@dataclass(slots=True)
class _Line:
    newest: Floats
    older: list[Floats | None] = field(default_factory=lambda: [None] * (PIECES - 1))
    cut: int = 0
    """How often the newest piece was full."""
    shown: int = 0


def is_step(marker: Marker) -> bool:
    """Whether a marker continues a line, as described above."""
    return marker.type == LINE_STRIP and marker.lifetime < 0 and len(marker.points) <= _STEP_POINTS


class GrowingLines:
    """The lines of one channel, by the id of their entity."""

    def __init__(self) -> None:
        self._lines: OrderedDict[str, _Line] = OrderedDict()

    def grow(self, entity_id: str, marker: Marker) -> dict[str, LinePrimitive]:
        """Take a step; gives the pieces to show now, by the id of their entity."""
        points = _points_of(marker)
        line = self._lines.pop(entity_id, None) or _Line(np.empty((0, 3)))
        self._lines[entity_id] = line
        if len(self._lines) > MAX_LINES:
            self._lines.popitem(last=False)
        if len(line.newest) and len(points) and np.array_equal(line.newest[-1], points[0]):
            points = points[1:]
        line.newest = np.concatenate((line.newest, points))
        shown = {}
        if len(line.newest) >= PIECE_POINTS:
            line.older[line.cut % len(line.older)] = line.newest
            line.shown = line.cut
            line.cut += 1
            line.newest = line.newest[-1:]
        count = min(line.cut, len(line.older))
        if count:
            index = line.shown % count
            line.shown += 1
            older = line.older[index]
            assert older is not None
            shown[_piece_id(entity_id, index)] = _strip(marker, older)
        shown[entity_id] = _strip(marker, line.newest)
        return shown

    def forget(self, entity_id: str) -> list[str]:
        """Give up a line; the ids of the entities that showed its older pieces."""
        line = self._lines.pop(entity_id, None)
        if line is None:
            return []
        return [_piece_id(entity_id, n) for n in range(min(line.cut, len(line.older)))]

    def clear(self) -> None:
        """Give up all lines."""
        self._lines.clear()


def _points_of(marker: Marker) -> Floats:
    place = placement(marker.pose)
    if not marker.points:
        return np.array([place.translation])
    return moved(vertices_of(marker).points, place)


def _strip(marker: Marker, points: Floats) -> LinePrimitive:
    line = line_primitive(LinePrimitive.LINE_STRIP, marker, Vertices(points, None))
    line.pose.orientation.w = 1.0
    return line


def _piece_id(entity_id: str, index: int) -> str:
    return f"{entity_id}/{index}"
