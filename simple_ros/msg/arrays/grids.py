"""OccupancyGrid messages as arrays."""

from __future__ import annotations

from math import isfinite

import numpy as np
from numpy.typing import NDArray

from simple_ros.msg.arrays._buffers import Array
from simple_ros.msg.geometry_msgs import Point, Pose, Quaternion
from simple_ros.msg.nav_msgs import MapMetaData, OccupancyGrid
from simple_ros.msg.std_msgs import Header

__all__ = ["numpy_to_occupancy_grid", "occupancy_grid_to_numpy"]


def occupancy_grid_to_numpy(grid: OccupancyGrid) -> NDArray[np.int8]:
    """Return the cells of a map: 0..100 per cent occupied, -1 unknown.

    Returns:
        Read-only view of shape (height, width). Row 0 has the least y, column 0 the least x; use
        ``numpy.flipud`` for an image with north up.

    Raises:
        ValueError: The data does not fit the size.
    """
    height, width = grid.info.height, grid.info.width
    data = grid.data  # each read of a bytes field is a copy, so there must be one only
    if len(data) != height * width:
        raise ValueError(
            f"OccupancyGrid of {height} rows of {width} cells needs {height * width} bytes of "
            f"data, has {len(data)}"
        )
    return np.frombuffer(data, np.int8).reshape(height, width)


def numpy_to_occupancy_grid(
    cells: Array,
    resolution_m: float,
    *,
    origin: Pose | None = None,
    header: Header | None = None,
) -> OccupancyGrid:
    """Return a map message with a copy of ``cells``.

    Args:
        cells: Integers of shape (height, width), row 0 with the least y: 0..100 per cent occupied,
            -1 unknown.
        resolution_m: Edge length of a cell.
        origin: Pose of the corner of cell (0, 0); by default at zero and not turned.
        header: Copied into the message.

    Raises:
        ValueError: The cells are no integers, do not fit 8 bits or have another shape, or the
            resolution is not positive.
    """
    if cells.ndim != 2:
        raise ValueError(f"cells need shape (height, width), got {cells.shape}")
    if cells.dtype.kind not in "iu":
        raise ValueError(
            f"cells are integers, per cent and -1, got {cells.dtype}; round them first"
        )
    if cells.size and not -128 <= int(cells.min()) <= int(cells.max()) <= 127:
        raise ValueError(
            f"cells lie in {cells.min()}..{cells.max()}, but must fit a signed byte: 0..100 or -1"
        )
    if not (isfinite(resolution_m) and resolution_m > 0):
        raise ValueError(f"resolution_m must be a positive length, got {resolution_m}")
    height, width = cells.shape
    not_turned = Pose(position=Point(), orientation=Quaternion(w=1.0))
    return OccupancyGrid(
        header=header,
        info=MapMetaData(
            resolution=resolution_m, width=width, height=height, origin=origin or not_turned
        ),
        data=cells.astype(np.int8, copy=False).tobytes(),
    )
