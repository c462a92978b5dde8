"""PointCloud2 messages as structured arrays.

A point is a record of ``point_step`` bytes; its ``fields`` say at which offset which number lies.
That is just what a structured dtype of numpy says, so both directions are a change of description.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import prod
from typing import Any

import numpy as np

from simple_ros.msg.arrays._buffers import Array, checked_step, is_big_endian, strided_view
from simple_ros.msg.sensor_msgs import PointCloud2, PointField
from simple_ros.msg.std_msgs import Header

__all__ = [
    "numpy_to_pointcloud2",
    "pointcloud2_dtype",
    "pointcloud2_to_numpy",
    "pointcloud2_to_points",
    "points_to_pointcloud2",
]

_CODES = {
    PointField.INT8: "i1",
    PointField.UINT8: "u1",
    PointField.INT16: "i2",
    PointField.UINT16: "u2",
    PointField.INT32: "i4",
    PointField.UINT32: "u4",
    PointField.FLOAT32: "f4",
    PointField.FLOAT64: "f8",
}
_DATATYPES = {code: datatype for datatype, code in _CODES.items()}
_MAX_POINT_STEP = 2**31 - 1  # numpy keeps the size of a record in a C int


def pointcloud2_dtype(cloud: PointCloud2) -> np.dtype[Any]:
    """Return the structured dtype of one point, in the byte order of the message.

    A field with ``count`` above 1 becomes a subarray.

    Raises:
        ValueError: A field has no name, an unknown datatype or one name with another field, or does
            not fit into ``point_step``.
    """
    if cloud.point_step > _MAX_POINT_STEP:
        raise ValueError(f"PointCloud2: point_step {cloud.point_step} is beyond {_MAX_POINT_STEP}")
    order = ">" if cloud.is_bigendian else "<"
    names, formats, offsets = [], [], []
    for field in cloud.fields:
        names.append(field.name)
        formats.append(_field_format(field, order, cloud.point_step))
        offsets.append(field.offset)
    if len(set(names)) != len(names):
        raise ValueError(f"PointCloud2: fields share a name: {names}")
    return np.dtype(
        {"names": names, "formats": formats, "offsets": offsets, "itemsize": cloud.point_step}
    )


def pointcloud2_to_numpy(cloud: PointCloud2) -> Array:
    """Return the points of a cloud, such that ``result["x"]`` are all x.

    Returns:
        Read-only structured view of shape (height, width), also where height is 1; ``ravel()``
        makes it flat. Its dtype is that of `pointcloud2_dtype`.

    Raises:
        ValueError: The fields make no sense, or the data does not fit the size.
    """
    dtype = pointcloud2_dtype(cloud)
    height, width, point = cloud.height, cloud.width, cloud.point_step
    data = cloud.data  # each read of a bytes field is a copy, so there must be one only
    what = f"PointCloud2 of {height}x{width} points of {point} bytes"
    if height and width and not point:
        raise ValueError(f"{what}: point_step must not be 0")
    step = checked_step(what, len(data), width * point, cloud.row_step, height)
    return strided_view(data, dtype, (height, width), (step, point))


def pointcloud2_to_points(cloud: PointCloud2, names: Sequence[str] = ("x", "y", "z")) -> Array:
    """Return chosen fields of all points as one plain array; invalid points (NaN) are kept.

    Returns:
        New array of shape (height * width, len(names)), of the least type that holds all fields.

    Raises:
        ValueError: A field is missing or has more than one element, or the cloud makes no sense.
    """
    points = pointcloud2_to_numpy(cloud).reshape(-1)
    there = _fields_of(points.dtype)
    for name in names:
        if name not in there or there[name][0].subdtype:
            raise ValueError(
                f"PointCloud2 has no field {name!r} with one element; its fields are {list(there)}"
            )
    native = [there[name][0].newbyteorder("=") for name in names]
    result: Array = np.empty((points.size, len(native)), np.result_type(*native))
    for column, name in enumerate(names):
        result[:, column] = points[name]
    return result


def numpy_to_pointcloud2(
    points: Array, *, header: Header | None = None, is_dense: bool | None = None
) -> PointCloud2:
    """Return a cloud message with a copy of structured points.

    Args:
        points: Structured array of shape (count,) or (height, width). Its fields are plain numbers
            or subarrays of them, all in one byte order. The layout is kept, padding included.
        header: Copied into the message.
        is_dense: True if no point is invalid; None finds out by looking for NaN and infinity.

    Raises:
        ValueError: The array is not structured, has another shape, or a field that PointField
            cannot describe.
    """
    if points.dtype.fields is None or points.ndim not in (1, 2):
        raise ValueError(
            "points must be a structured array of shape (count,) or (height, width), got "
            f"{points.dtype} of shape {points.shape}; points_to_pointcloud2() takes plain arrays"
        )
    fields, big_endian = _describe(points.dtype)
    height, width = points.shape if points.ndim == 2 else (1, points.size)
    return PointCloud2(
        header=header,
        height=height,
        width=width,
        fields=fields,
        is_bigendian=big_endian,
        point_step=points.dtype.itemsize,
        row_step=points.dtype.itemsize * width,
        data=points.tobytes(),
        is_dense=_all_finite(points) if is_dense is None else is_dense,
    )


def points_to_pointcloud2(
    points: Array,
    names: Sequence[str] = ("x", "y", "z"),
    *,
    header: Header | None = None,
    is_dense: bool | None = None,
) -> PointCloud2:
    """Return a cloud message from a plain array with one column per field.

    Args:
        points: Shape (count, len(names)), of any type PointField knows, such as float32.
        names: Names of the columns.
        header: Copied into the message.
        is_dense: True if no point is invalid; None finds out by looking for NaN and infinity.

    Raises:
        ValueError: The shape does not fit the names, or the type is unknown to PointField.
    """
    if points.ndim != 2 or points.shape[1] != len(names):
        raise ValueError(
            f"fields {list(names)} need an array of shape (count, {len(names)}), got {points.shape}"
        )
    record = np.dtype([(name, points.dtype) for name in names])
    rows = np.ascontiguousarray(points)
    structured = np.ndarray(len(rows), record, buffer=rows.data if rows.size else None)
    return numpy_to_pointcloud2(structured, header=header, is_dense=is_dense)


def _field_format(field: PointField, order: str, point_step: int) -> tuple[str, int] | str:
    code = _CODES.get(field.datatype)
    if not field.name or code is None:
        raise ValueError(
            f"PointCloud2: field {field.name!r} with datatype {field.datatype} needs a name and "
            "one of the datatypes INT8 to FLOAT64"
        )
    count = field.count or 1
    end = field.offset + count * int(code[1:])
    if end > point_step:
        raise ValueError(
            f"PointCloud2: field {field.name!r} ends at byte {end} of a point of {point_step} bytes"
        )
    return f"{order}{code}" if count == 1 else (f"{order}{code}", count)


def _describe(record: np.dtype[Any]) -> tuple[list[PointField], bool]:
    """The fields of a record in their order, and whether they are big-endian."""
    fields = []
    orders = set()
    for name, (dtype, offset, *_) in _fields_of(record).items():
        base, shape = dtype.subdtype or (dtype, ())
        code = f"{base.kind}{base.itemsize}"
        if code not in _DATATYPES:
            raise ValueError(
                f"field {name!r} of {dtype} cannot be a PointField; use integers of 8, 16 or 32 "
                "bits or floats of 32 or 64 bits"
            )
        if base.itemsize > 1:
            orders.add(is_big_endian(base))
        fields.append(
            PointField(name=name, offset=offset, datatype=_DATATYPES[code], count=prod(shape))
        )
    if len(orders) > 1:
        raise ValueError(
            "fields of both byte orders cannot share a PointCloud2; convert one of them"
        )
    return fields, True in orders


def _fields_of(record: np.dtype[Any]) -> Mapping[str, tuple[Any, ...]]:
    """Type and offset of each field, in the order of the record."""
    return {name: record.fields[name] for name in record.names or () if record.fields}


def _all_finite(points: Array) -> bool:
    return all(bool(np.isfinite(points[name]).all()) for name in points.dtype.names or ())
