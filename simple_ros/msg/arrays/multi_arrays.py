"""The array messages of std_msgs as arrays with axes.

The layout gives each axis a size and a stride. The stride of an axis counts the elements of that
axis and all that follow, so element (i, j, k) lies at
``data_offset + stride[1] * i + stride[2] * j + k``; the stride of the first axis is not looked at.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import prod
from typing import Any, TypeAlias

import numpy as np

from simple_ros.msg import std_msgs
from simple_ros.msg.arrays._buffers import Array, strided_view
from simple_ros.msg.arrays.repeated import as_integers, numpy_to_repeated, repeated_to_numpy

__all__ = ["MultiArray", "multiarray_to_numpy", "numpy_to_multiarray"]

MultiArray: TypeAlias = (
    std_msgs.ByteMultiArray
    | std_msgs.Int8MultiArray
    | std_msgs.Int16MultiArray
    | std_msgs.Int32MultiArray
    | std_msgs.Int64MultiArray
    | std_msgs.UInt8MultiArray
    | std_msgs.UInt16MultiArray
    | std_msgs.UInt32MultiArray
    | std_msgs.UInt64MultiArray
    | std_msgs.Float32MultiArray
    | std_msgs.Float64MultiArray
)

_CLASSES: dict[str, type[MultiArray]] = {
    "int8": std_msgs.Int8MultiArray,
    "int16": std_msgs.Int16MultiArray,
    "int32": std_msgs.Int32MultiArray,
    "int64": std_msgs.Int64MultiArray,
    "uint8": std_msgs.UInt8MultiArray,
    "uint16": std_msgs.UInt16MultiArray,
    "uint32": std_msgs.UInt32MultiArray,
    "uint64": std_msgs.UInt64MultiArray,
    "float32": std_msgs.Float32MultiArray,
    "float64": std_msgs.Float64MultiArray,
}
_DTYPES: dict[type[MultiArray], np.dtype[Any]] = {
    **{cls: np.dtype(name) for name, cls in _CLASSES.items()},
    std_msgs.ByteMultiArray: np.dtype(np.uint8),
}

_MAX_AXES = 32  # of numpy 1; numpy 2 takes 64


def multiarray_to_numpy(message: MultiArray) -> Array:
    """Return the elements of an array message, with one axis per dimension of its layout.

    Without dimensions the result has one axis over all data from ``data_offset`` on. A stride of 0
    counts as tightly packed.

    Returns:
        Array of the type in the name of the message (octets are uint8), which may be read-only.

    Raises:
        ValueError: The message is of another type, its layout reaches beyond the data, axes overlap
            or are more than 32, or an element does not fit the type.
    """
    flat = _flat(message)
    offset = message.layout.data_offset
    if offset > flat.size:
        raise ValueError(f"{_name(message)}: data_offset {offset} is beyond {flat.size} elements")
    flat = flat[offset:]
    if not message.layout.dim:
        return flat
    if len(message.layout.dim) > _MAX_AXES:
        raise ValueError(f"{_name(message)}: more than {_MAX_AXES} axes in the layout")
    shape = [dim.size for dim in message.layout.dim]
    steps = _steps(message, shape)
    reach = 0 if 0 in shape else 1 + sum((n - 1) * s for n, s in zip(shape, steps, strict=True))
    if reach > flat.size:
        raise ValueError(
            f"{_name(message)}: the layout of shape {tuple(shape)} needs {reach} elements from "
            f"data_offset on, there are {flat.size}"
        )
    strides = [step * flat.itemsize for step in steps]
    return strided_view(flat, flat.dtype, shape, strides)


def numpy_to_multiarray(array: Array, labels: Sequence[str] = ()) -> MultiArray:
    """Return the array message for the type of ``array``, with a copy of its elements.

    Args:
        array: Integers of 8 to 64 bits or floats of 32 or 64 bits, with 1 to 32 axes.
        labels: What the axes mean, one per axis, or none at all.

    Raises:
        ValueError: There is no message for that type, or the labels do not fit the axes.
    """
    cls = _CLASSES.get(array.dtype.name)
    if cls is None or not 1 <= array.ndim <= _MAX_AXES:
        raise ValueError(
            f"no MultiArray holds an array of {array.dtype} with {array.ndim} axes; use 1 to "
            f"{_MAX_AXES} axes of {', '.join(_CLASSES)}"
        )
    if labels and len(labels) != array.ndim:
        raise ValueError(f"{len(labels)} labels for an array of {array.ndim} axes")
    message = cls()
    for axis, size in enumerate(array.shape):
        label = labels[axis] if labels else ""
        message.layout.dim.add(label=label, size=size, stride=prod(array.shape[axis:]))
    if isinstance(message, std_msgs.Int8MultiArray | std_msgs.UInt8MultiArray):
        message.data = array.tobytes()
    else:
        numpy_to_repeated(message, "data", array.ravel())
    return message


def _flat(message: MultiArray) -> Array:
    dtype = _DTYPES.get(type(message))
    if dtype is None:
        raise ValueError(f"{_name(message)} is no MultiArray; repeated_to_numpy() reads any field")
    if dtype.itemsize == 1:
        data: Any = message.data
        return np.frombuffer(data, dtype)
    flat = repeated_to_numpy(message, "data")
    return flat if dtype.kind == "f" else as_integers(f"{_name(message)}.data", flat, dtype)


def _steps(message: MultiArray, shape: list[int]) -> list[int]:
    """Elements from one place to the next along each axis.

    Axes that share elements are refused: a few bytes from a peer could claim an array without end.
    """
    steps = [1]
    for axis in range(len(shape) - 1, 0, -1):
        packed = shape[axis] * steps[0]
        stride = message.layout.dim[axis].stride or packed
        if stride < packed:
            raise ValueError(
                f"{_name(message)}: axis {axis} of {shape[axis]} places needs a stride of {packed} "
                f"or more, has {stride}"
            )
        steps.insert(0, stride)
    return steps


def _name(message: MultiArray) -> str:
    return message.DESCRIPTOR.full_name
