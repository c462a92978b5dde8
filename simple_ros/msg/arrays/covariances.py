"""Covariance matrices: fixed arrays in ROS, ``repeated double`` here, row by row."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from simple_ros.msg.arrays._buffers import Array

__all__ = ["covariance_3x3", "covariance_6x6", "numpy_to_covariance"]

_SIZES = (3, 6)


def covariance_3x3(values: Sequence[float]) -> NDArray[np.float64]:
    """Return a new 3x3 matrix, as from ``imu.orientation_covariance``; see `covariance_6x6`."""
    return _matrix(values, 3)


def covariance_6x6(values: Sequence[float]) -> NDArray[np.float64]:
    """Return a new 6x6 matrix, such as from ``odometry.pose.covariance``.

    A field never set is empty and gives zeros, as an array never set does in ROS.

    Raises:
        ValueError: The field has neither 0 nor 36 values.
    """
    return _matrix(values, 6)


def numpy_to_covariance(matrix: Array) -> list[float]:
    """Return the values of a 3x3 or 6x6 matrix for a covariance field.

    Assign them to the whole field: ``imu.orientation_covariance[:] = numpy_to_covariance(matrix)``.

    Raises:
        ValueError: The matrix has another shape.
    """
    if matrix.shape not in [(size, size) for size in _SIZES]:
        raise ValueError(f"a covariance has shape (3, 3) or (6, 6), got {matrix.shape}")
    values: list[float] = matrix.astype(np.float64).ravel().tolist()
    return values


def _matrix(values: Sequence[float], size: int) -> NDArray[np.float64]:
    if not values:
        return np.zeros((size, size))
    if len(values) != size * size:
        raise ValueError(
            f"a {size}x{size} covariance has {size * size} values, or none if unset; "
            f"this field has {len(values)}"
        )
    return np.array(values, np.float64).reshape(size, size)
