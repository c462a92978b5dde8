"""LaserScan messages as arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from simple_ros.msg.arrays.repeated import repeated_to_numpy
from simple_ros.msg.sensor_msgs import LaserScan

__all__ = [
    "laser_scan_angles",
    "laser_scan_intensities",
    "laser_scan_points",
    "laser_scan_ranges",
]


def laser_scan_ranges(scan: LaserScan) -> NDArray[np.float32]:
    """Return the distance of each beam in m, shape (beams,), as sent: invalid ones included."""
    return repeated_to_numpy(scan, "ranges")


def laser_scan_intensities(scan: LaserScan) -> NDArray[np.float32]:
    """Return the strength of each echo in the unit of the device, shape (beams,).

    Raises:
        ValueError: There are intensities, but not as many as ranges.
    """
    if scan.intensities and len(scan.intensities) != len(scan.ranges):
        raise ValueError(
            f"LaserScan has {len(scan.ranges)} ranges but {len(scan.intensities)} intensities"
        )
    return repeated_to_numpy(scan, "intensities")


def laser_scan_angles(scan: LaserScan) -> NDArray[np.float64]:
    """Return the direction of each beam in rad, counter-clockwise about +z, shape (beams,)."""
    return scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges), dtype=np.float64)


def laser_scan_points(scan: LaserScan) -> NDArray[np.float64]:
    """Return the points that valid beams hit, in m, in the frame of the scanner.

    A beam is valid if its range is finite and within ``range_min``..``range_max``.

    Returns:
        New array of shape (valid beams, 2), columns x (ahead) and y (left).
    """
    ranges = laser_scan_ranges(scan).astype(np.float64)
    valid = np.isfinite(ranges) & (ranges >= scan.range_min) & (ranges <= scan.range_max)
    angles = laser_scan_angles(scan)[valid]
    points: NDArray[np.float64] = np.column_stack((np.cos(angles), np.sin(angles)))
    return points * ranges[valid, np.newaxis]
