"""Image messages as arrays.

An encoding names the channels of a pixel and the type of each, in one of three ways: a colour space
with a size (``rgb8``, ``mono16``), a mosaic of a sensor (``bayer_rggb8``), or the bare type in the
spelling of OpenCV (``32FC1``: 32 bits, float, 1 channel). ``S`` is signed, ``U`` unsigned.
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Any

import numpy as np

from simple_ros.msg.arrays._buffers import Array, checked_step, is_big_endian, strided_view
from simple_ros.msg.sensor_msgs import Image
from simple_ros.msg.std_msgs import Header

__all__ = ["image_to_numpy", "image_type", "numpy_to_image"]

_COLOUR_CHANNELS = {"mono": 1, "rgb": 3, "bgr": 3, "rgba": 4, "bgra": 4}
_BAYER_PATTERNS = ("rggb", "bggr", "gbrg", "grbg")
_NAMED = {
    **{f"{name}{bits}": (f"u{bits // 8}", count)
       for name, count in _COLOUR_CHANNELS.items() for bits in (8, 16)},
    **{f"bayer_{name}{bits}": (f"u{bits // 8}", 1)
       for name in _BAYER_PATTERNS for bits in (8, 16)},
    **dict.fromkeys(("yuv422", "uyvy", "yuv422_yuy2", "yuyv"), ("u1", 2)),
}  # fmt: skip
_OPENCV = re.compile(r"(8U|8S|16U|16S|32S|32F|64F)C([1-9][0-9]{0,2})")
_OPENCV_KINDS = {"U": "u", "S": "i", "F": "f"}


@lru_cache(maxsize=64)
def image_type(encoding: str) -> tuple[np.dtype[Any], int]:
    """Return the type of a channel, in native byte order, and the number of channels of a pixel.

    Raises:
        ValueError: The encoding is unknown, or no array of pixels (compressed, planar).
    """
    if encoding in _NAMED:
        code, channels = _NAMED[encoding]
        return np.dtype(code), channels
    if match := _OPENCV.fullmatch(encoding):
        bits, kind = int(match[1][:-1]), _OPENCV_KINDS[match[1][-1]]
        return np.dtype(f"{kind}{bits // 8}"), int(match[2])
    raise ValueError(
        f"unknown image encoding {encoding!r}; known are rgb8, bgr8, rgba8, bgra8, mono8 (each "
        "with 16 as well), bayer_rggb8 and its like, yuv422, yuyv, and the OpenCV types such as "
        "8UC3, 16UC1, 32FC1"
    )


def image_to_numpy(image: Image) -> Array:
    """Return the pixels of an image, top row first.

    The channels stay in the order of the encoding and the bytes in the order of ``is_bigendian``;
    padding after a row is left out. A ``step`` of 0 counts as no padding.

    Returns:
        Read-only view of shape (height, width) for one channel, else (height, width, channels).

    Raises:
        ValueError: The encoding is unknown, or the data does not fit the size.
    """
    dtype, channels = image_type(image.encoding)
    if image.is_bigendian:
        dtype = dtype.newbyteorder(">")
    elif dtype.itemsize > 1:
        dtype = dtype.newbyteorder("<")
    height, width, pixel = image.height, image.width, dtype.itemsize * channels
    what = f"Image {width}x{height} {image.encoding!r}"
    data = image.data  # each read of a bytes field is a copy, so there must be one only
    step = checked_step(what, len(data), width * pixel, image.step, height)
    if channels == 1:
        return strided_view(data, dtype, (height, width), (step, pixel))
    return strided_view(data, dtype, (height, width, channels), (step, pixel, dtype.itemsize))


def numpy_to_image(array: Array, encoding: str, *, header: Header | None = None) -> Image:
    """Return an image message with a copy of the pixels in ``array``, without padding.

    Args:
        array: Shape (height, width) or (height, width, channels), of the type of the encoding, in
            either byte order and with any strides.
        encoding: Such as ``"rgb8"``; see `image_type`.
        header: Copied into the message.

    Raises:
        ValueError: The encoding is unknown, or the array does not fit it.
    """
    dtype, channels = image_type(encoding)
    if array.dtype.newbyteorder("=") != dtype:
        raise ValueError(
            f"encoding {encoding!r} needs an array of {dtype}, got {array.dtype}; "
            f"convert it with array.astype({dtype.name!r}) if the values fit"
        )
    shape = array.shape if array.ndim == 3 else (*array.shape, 1)
    if len(shape) != 3 or shape[2] != channels:
        wanted = "(height, width)" if channels == 1 else f"(height, width, {channels})"
        raise ValueError(f"encoding {encoding!r} needs shape {wanted}, got {array.shape}")
    height, width, _ = shape
    return Image(
        header=header,
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=is_big_endian(array.dtype),
        step=width * channels * dtype.itemsize,
        data=array.tobytes(),
    )
