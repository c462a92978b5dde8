"""Laser scans and point clouds."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from foxglove_schemas_protobuf.LaserScan_pb2 import LaserScan as FoxgloveLaserScan
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3

from simple_ros.foxglove.convert.base import Context, Converter, described
from simple_ros.foxglove.convert.common import frame_of, stamp_of
from simple_ros.msg.arrays import (
    laser_scan_intensities,
    laser_scan_ranges,
    numpy_to_repeated,
    pointcloud2_dtype,
    pointcloud2_to_numpy,
)
from simple_ros.msg.sensor_msgs import LaserScan, PointCloud2, PointField
from simple_ros.protobuf_wire import split_field, with_field

__all__ = ["PointCloudConverter", "laser_scan"]

_HERE = Pose(position=Vector3(), orientation=Quaternion(w=1.0))
_ROS_DATA = PointCloud2.DESCRIPTOR.fields_by_name["data"].number
_DATA = PointCloud.DESCRIPTOR.fields_by_name["data"].number
_TYPES = {
    PointField.INT8: (PackedElementField.INT8, 1),
    PointField.UINT8: (PackedElementField.UINT8, 1),
    PointField.INT16: (PackedElementField.INT16, 2),
    PointField.UINT16: (PackedElementField.UINT16, 2),
    PointField.INT32: (PackedElementField.INT32, 4),
    PointField.UINT32: (PackedElementField.UINT32, 4),
    PointField.FLOAT32: (PackedElementField.FLOAT32, 4),
    PointField.FLOAT64: (PackedElementField.FLOAT64, 8),
}
_COLOUR_BYTES = ("blue", "green", "red", "alpha")
"""Of a packed colour, as they lie in memory of a little-endian machine."""
_MAX_FIELDS = 256


def laser_scan(message: LaserScan, context: Context) -> FoxgloveLaserScan:
    """A scan; ranges outside of what the scanner measures become NaN, which nobody draws.

    The last angle follows from ``angle_increment``, since panels spread the beams evenly up to it.

    Raises:
        ValueError: There are intensities, but not one for each range.
    """
    ranges = laser_scan_ranges(message).astype(np.float64)
    intensities = laser_scan_intensities(message).astype(np.float64)
    outside = ranges < message.range_min
    if message.range_max > 0:
        outside |= ranges > message.range_max
    ranges[outside] = np.nan
    end = message.angle_max
    if message.angle_increment and len(ranges):
        end = message.angle_min + message.angle_increment * (len(ranges) - 1)
    scan = FoxgloveLaserScan(
        timestamp=stamp_of(message.header, context),
        frame_id=frame_of(message.header, context),
        pose=_HERE,
        start_angle=message.angle_min,
        end_angle=end,
    )
    numpy_to_repeated(scan, "ranges", ranges)
    numpy_to_repeated(scan, "intensities", intensities)
    return scan


class PointCloudConverter(Converter):
    """``sensor_msgs.PointCloud2`` as ``foxglove.PointCloud``.

    The points are taken over as they lie. They are moved only where the schema cannot say how they
    lie (bytes in the other order, rows with padding), and where a packed colour ``rgb`` needs its
    fourth byte as alpha. A packed colour becomes the fields red, green, blue and alpha.
    """

    schema_name = PointCloud.DESCRIPTOR.full_name
    suffix = "/points"

    @property
    def schema(self) -> bytes:
        """See `Converter`."""
        return described(PointCloud)

    def _converted(self, message: bytes, context: Context) -> bytes:
        rest, data = split_field(message, _ROS_DATA)
        cloud = PointCloud2.FromString(rest)
        pointcloud2_dtype(cloud)
        result = PointCloud(
            timestamp=stamp_of(cloud.header, context),
            frame_id=frame_of(cloud.header, context),
            pose=_HERE,
            point_stride=cloud.point_step,
            fields=_fields(cloud),
        )
        opaque = _packed_without_alpha(cloud)
        if opaque or not _is_plain(cloud, len(data)):
            cloud.data = bytes(data)
            data = _moved(cloud, opaque)
        return with_field(result, _DATA, data)


def _is_plain(cloud: PointCloud2, size: int) -> bool:
    """Whether the points lie one after the other, in the byte order of the schema."""
    row = cloud.width * cloud.point_step
    return not cloud.is_bigendian and size == row * cloud.height


def _moved(cloud: PointCloud2, opaque: list[int]) -> memoryview:
    """The points one after the other, little-endian, the bytes at those offsets 255."""
    points = pointcloud2_to_numpy(cloud)
    moved = np.zeros(points.shape, points.dtype.newbyteorder("<"))
    for name in points.dtype.names or ():
        moved[name] = points[name]
    raw = moved.view(np.uint8).reshape(-1, cloud.point_step)
    for offset in opaque:
        raw[:, offset] = 255
    return raw.reshape(-1).data


def _fields(cloud: PointCloud2) -> Iterator[PackedElementField]:
    """The fields of a point; one with several elements becomes ``name_0``, ``name_1`` ...

    Raises:
        ValueError: There are too many.
    """
    if sum(field.count or 1 for field in cloud.fields) > _MAX_FIELDS:
        raise ValueError(f"a point of it has more than {_MAX_FIELDS} numbers")
    for field in cloud.fields:
        if _is_packed_colour(field):
            for place, name in enumerate(_COLOUR_BYTES):
                kind = PackedElementField.UINT8
                yield PackedElementField(name=name, offset=field.offset + place, type=kind)
            continue
        kind, size = _TYPES[field.datatype]
        count = field.count or 1
        for index in range(count):
            name = field.name if count == 1 else f"{field.name}_{index}"
            yield PackedElementField(name=name, offset=field.offset + index * size, type=kind)


def _is_packed_colour(field: PointField) -> bool:
    wide = (PointField.FLOAT32, PointField.UINT32, PointField.INT32)
    return field.name in ("rgb", "rgba") and field.datatype in wide and field.count <= 1


def _packed_without_alpha(cloud: PointCloud2) -> list[int]:
    """Where the alpha of colours without one would lie."""
    fields = cloud.fields
    return [
        field.offset + 3 for field in fields if field.name == "rgb" and _is_packed_colour(field)
    ]
