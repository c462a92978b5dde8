"""Making sensor data smaller: pictures by pixels, point clouds by voxels, both by rate. Pure."""

from __future__ import annotations

import numpy as np

from simple_ros.msg.sensor_msgs import Image, PointCloud2, PointField

__all__ = ["RateGate", "scaled", "voxels"]


class RateGate:
    """Lets through at most so many a second, evenly.

    Attributes:
        rate_hz: How many; 0 lets all through.
    """

    def __init__(self, rate_hz: float = 0.0) -> None:
        self.rate_hz = rate_hz
        self._due_s = -np.inf

    def passes(self, now_s: float) -> bool:
        """Whether what came now goes through."""
        if self.rate_hz <= 0:
            return True
        # A tenth of a period early is on time: sources jitter.
        period_s = 1 / self.rate_hz
        if now_s < self._due_s - 0.1 * period_s:
            return False
        self._due_s = max(self._due_s, now_s - 0.1 * period_s) + period_s
        return True


def scaled(image: Image, percent: float) -> Image | None:
    """The picture with fewer pixels, the nearest of each taken.

    Args:
        image: Of whole bytes a pixel.
        percent: Of each side, below 100.

    Returns:
        A new message; None if the picture is not of whole bytes a pixel, or its data does not fit it.
    """
    width, height, step = image.width, image.height, image.step
    data = image.data
    if not width or not height or step < width or len(data) < step * height:
        return None
    size = step // width
    if size * width > step or image.encoding.startswith(("bayer", "yuv", "nv")):
        return None
    to_width = max(1, round(width * percent / 100))
    to_height = max(1, round(height * percent / 100))
    rows = np.frombuffer(data, np.uint8, step * height).reshape(height, step)
    pixels = rows[:, : size * width].reshape(height, width, size)
    picked_rows = np.arange(to_height) * height // to_height
    picked_columns = np.arange(to_width) * width // to_width
    return Image(
        header=image.header,
        height=to_height,
        width=to_width,
        encoding=image.encoding,
        is_bigendian=image.is_bigendian,
        step=to_width * size,
        data=pixels[picked_rows][:, picked_columns].tobytes(),
    )


def voxels(cloud: PointCloud2, leaf_m: float) -> PointCloud2 | None:
    """The cloud with the first point of each voxel only, in the order they came.

    Args:
        cloud: With fields x, y and z of 32 bits; further fields stay with their point.
        leaf_m: Edge of a voxel.

    Returns:
        A new message; None if the cloud has no such fields, or its data does not fit it.
    """
    offsets = {field.name: field.offset for field in cloud.fields if _is_float(field)}
    count, step = cloud.width * cloud.height, cloud.point_step
    fits = cloud.row_step == cloud.width * step and len(cloud.data) == count * step
    if not {"x", "y", "z"} <= offsets.keys() or not count or not fits:
        return None
    if max(offsets[axis] for axis in "xyz") + 4 > step:
        return None
    points = np.frombuffer(cloud.data, np.uint8).reshape(count, step)
    order = ">f4" if cloud.is_bigendian else "<f4"
    axes = [
        np.ascontiguousarray(points[:, offsets[axis] : offsets[axis] + 4]).view(order)[:, 0]
        for axis in "xyz"
    ]
    places = np.stack(axes, 1).astype(np.float64)
    finite = np.isfinite(places).all(axis=1)
    cells = np.floor(places[finite] / leaf_m).astype(np.int64)
    _, first = np.unique(cells, axis=0, return_index=True)
    kept = points[finite][np.sort(first)]
    return PointCloud2(
        header=cloud.header,
        height=1,
        width=len(kept),
        fields=cloud.fields,
        is_bigendian=cloud.is_bigendian,
        point_step=step,
        row_step=len(kept) * step,
        data=kept.tobytes(),
        is_dense=True,
    )


def _is_float(field: PointField) -> bool:
    return field.datatype == PointField.FLOAT32
