"""Occupancy grids, as coloured cells."""

from __future__ import annotations

import numpy as np
from foxglove_schemas_protobuf.Grid_pb2 import Grid
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.Vector2_pb2 import Vector2
from numpy.typing import NDArray

from simple_ros.foxglove.convert.base import Context, Converter, described
from simple_ros.foxglove.convert.common import frame_of, placed, stamp_of
from simple_ros.msg.nav_msgs import OccupancyGrid
from simple_ros.protobuf_wire import split_field, with_field

__all__ = ["GridConverter"]

_ROS_DATA = OccupancyGrid.DESCRIPTOR.fields_by_name["data"].number
_DATA = Grid.DESCRIPTOR.fields_by_name["data"].number
_CELL_BYTES = 4
_FIELDS = [
    PackedElementField(name=name, offset=offset, type=PackedElementField.UINT8)
    for offset, name in enumerate(("red", "green", "blue", "alpha"))
]

_UNKNOWN = 255
"""-1 as an unsigned byte."""
_BELOW_ZERO = slice(128, 255)
_ABOVE_HUNDRED = slice(101, 128)


def _table(colors: NDArray[np.uint8]) -> NDArray[np.uint32]:
    """A pixel for each of the 256 values of a cell's byte."""
    return np.ascontiguousarray(colors).view(np.uint32)[:, 0]


def _map_colors() -> NDArray[np.uint32]:
    """Free is white, occupied black, unknown transparent; what is out of range is red or green."""
    colors = np.zeros((256, 4), np.uint8)
    percent = np.arange(101)
    colors[:101, :3] = np.round(255 - 2.55 * percent)[:, np.newaxis]
    colors[:101, 3] = 255
    colors[_ABOVE_HUNDRED] = (0, 200, 0, 255)
    colors[_BELOW_ZERO] = (220, 0, 0, 255)
    return _table(colors)


def _costmap_colors() -> NDArray[np.uint32]:
    """Free is transparent, costs go from blue to red, 99 is cyan, lethal magenta, unknown grey."""
    colors = np.zeros((256, 4), np.uint8)
    share = np.arange(1, 99) / 98
    colors[1:99, 0] = np.round(255 * share)
    colors[1:99, 2] = np.round(255 * (1 - share))
    colors[1:99, 3] = 200
    colors[99] = (0, 255, 255, 200)
    colors[100] = (255, 0, 255, 200)
    colors[_ABOVE_HUNDRED] = (0, 200, 0, 200)
    colors[_BELOW_ZERO] = (220, 220, 0, 200)
    colors[_UNKNOWN] = (112, 128, 128, 128)
    return _table(colors)


_MAP = _map_colors()
_COSTMAP = _costmap_colors()


class GridConverter(Converter):
    """``nav_msgs.OccupancyGrid`` as ``foxglove.Grid`` with a colour for each cell.

    A topic with ``costmap`` in its name gets colours for costs, any other those of a map.
    """

    schema_name = Grid.DESCRIPTOR.full_name
    suffix = "/grid"

    @property
    def schema(self) -> bytes:
        """See `Converter`."""
        return described(Grid)

    def _converted(self, message: bytes, context: Context) -> bytes | None:
        rest, data = split_field(message, _ROS_DATA)
        grid = OccupancyGrid.FromString(rest)
        info = grid.info
        if len(data) != info.width * info.height:
            raise ValueError(
                f"a grid of {info.height} rows of {info.width} cells has {len(data)} bytes of data"
            )
        if not len(data):
            return None
        colors = _COSTMAP if "costmap" in context.topic.lower() else _MAP
        result = Grid(
            timestamp=stamp_of(grid.header, context),
            frame_id=frame_of(grid.header, context),
            pose=placed(info.origin),
            column_count=info.width,
            cell_size=Vector2(x=info.resolution, y=info.resolution),
            row_stride=_CELL_BYTES * info.width,
            cell_stride=_CELL_BYTES,
            fields=_FIELDS,
        )
        cells = np.take(colors, np.frombuffer(data, np.uint8))
        return with_field(result, _DATA, cells.view(np.uint8).data)
