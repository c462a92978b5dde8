"""What the converters share: views on bytes, sizes of rows, byte order."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


def strided_view(
    data: bytes | Array, dtype: np.dtype[Any], shape: Sequence[int], strides: Sequence[int]
) -> Array:
    """Return a read-only view on contiguous ``data``; strides are in bytes.

    Raises:
        ValueError: The view would reach beyond ``data``.
    """
    view: Array
    if 0 in shape:
        view = np.empty(shape, dtype)
    else:
        view = np.ndarray(shape, dtype, buffer=data, strides=strides)
    view.flags.writeable = False
    return view


def checked_step(what: str, size: int, row: int, step: int, height: int) -> int:
    """Return the bytes from row to row of data that is ``size`` bytes long.

    Args:
        what: What the data belongs to, for the error message.
        size: Bytes there are.
        row: Bytes of a row in use.
        step: Bytes of a row as the message says, padding included; 0 counts as no padding.
        height: Number of rows.

    Raises:
        ValueError: A row does not fit its step, or the data is shorter than the rows or longer.
    """
    step = step or row
    if step < row:
        raise ValueError(f"{what}: a row needs {row} bytes, but its step is {step}")
    # Some senders leave out the padding after the last row.
    least = step * (height - 1) + row if height else 0
    if not least <= size <= step * height:
        raise ValueError(
            f"{what}: data has {size} bytes, but {height} rows of {step} bytes are {step * height}"
        )
    return step


def is_big_endian(dtype: np.dtype[Any]) -> bool:
    """Tell whether numbers of a plain dtype are stored most significant byte first."""
    return dtype.byteorder == ">" or (dtype.byteorder == "=" and sys.byteorder == "big")
