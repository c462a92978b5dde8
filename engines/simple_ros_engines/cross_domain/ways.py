"""Maps and paths between messages and what `path` and `quality_map` compute with. Pure."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from simple_ros.msg.arrays import occupancy_grid_to_numpy
from simple_ros.msg.geometry_msgs import Pose, PoseStamped, Quaternion
from simple_ros.msg.nav_msgs import OccupancyGrid, Path
from simple_ros.msg.wireless_ros_msgs import OptimizePathResponse
from simple_ros.msg.wireless_ros_msgs import PathQuality as PathQualityMessage
from simple_ros_engines.cross_domain.path import (
    PathQuality,
    PathWeights,
    analyze_path,
    plan_between,
)
from simple_ros_engines.cross_domain.quality_map import GridFrame, QualityMap

__all__ = ["MOST_WEIGHT", "better_way", "frame_of"]

MOST_WEIGHT = 100.0


def better_way(
    path: Path, grid: OccupancyGrid | None, quality: QualityMap | None, weight: float
) -> OptimizePathResponse:
    """A way with better coverage between the ends of a path, with numbers before and after.

    Args:
        path: First and last pose count.
        grid: Where obstacles are; None while there is no map.
        quality: What is known of the radio there.
        weight: What coverage is worth (`PathWeights.weight`).
    """
    if grid is None or quality is None:
        return OptimizePathResponse(message="there is no map yet (topic /map)")
    points = [(pose.pose.position.x, pose.pose.position.y) for pose in path.poses]
    if len(points) < 2:
        return OptimizePathResponse(message="a path needs two poses or more")
    if not all(math.isfinite(x) and math.isfinite(y) for x, y in points):
        return OptimizePathResponse(message="the path has a place that is no number")
    if not 0 <= weight <= MOST_WEIGHT:
        return OptimizePathResponse(
            message=f"weight is {weight:g}, must be from 0 to {MOST_WEIGHT:g}"
        )
    before = analyze_path(points, quality)
    cells: NDArray[np.int8] = occupancy_grid_to_numpy(grid)
    way = plan_between(cells, quality, points[0], points[-1], PathWeights(weight))
    if way is None:
        text = "an end is outside the map or in an obstacle, or no way leads there"
        return OptimizePathResponse(message=text, before=_quality_message(before))
    after = analyze_path(way, quality)
    return OptimizePathResponse(
        success=True,
        message=_told(before, after),
        path=_path_message(path, way),
        before=_quality_message(before),
        after=_quality_message(after),
    )


def frame_of(grid: OccupancyGrid) -> GridFrame | None:
    """Size and place of a map; None if it has no cells, no resolution or no place."""
    info = grid.info
    if not (info.width and info.height and info.resolution > 0):
        return None
    if len(grid.data) != info.width * info.height:
        return None
    turn: Quaternion = info.origin.orientation
    yaw = math.atan2(
        2 * (turn.w * turn.z + turn.x * turn.y), 1 - 2 * (turn.y * turn.y + turn.z * turn.z)
    )
    at = info.origin.position
    if not all(map(math.isfinite, (info.resolution, at.x, at.y, yaw))):
        return None
    return GridFrame(info.width, info.height, info.resolution, at.x, at.y, yaw)


def _quality_message(quality: PathQuality) -> PathQualityMessage:
    return PathQualityMessage(
        length_m=quality.length_m,
        mean=quality.mean,
        minimum=quality.minimum,
        dead_zone_m=quality.dead_zone_m,
        unknown_m=quality.unknown_m,
    )


def _path_message(path: Path, way: list[tuple[float, float]]) -> Path:
    result = Path(header=path.header)
    last = path.poses[-1].pose
    for index, (x, y) in enumerate(way):
        following = way[min(index + 1, len(way) - 1)]
        pose = Pose()
        pose.position.x, pose.position.y = x, y
        if index == len(way) - 1:
            pose.orientation.CopyFrom(last.orientation)
        else:
            yaw = math.atan2(following[1] - y, following[0] - x)
            pose.orientation.z, pose.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)
        result.poses.append(PoseStamped(header=path.header, pose=pose))
    return result


def _told(before: PathQuality, after: PathQuality) -> str:
    return (
        f"quality mean {before.mean:.2f} -> {after.mean:.2f}, "
        f"least {before.minimum:.2f} -> {after.minimum:.2f}, "
        f"in dead zones {before.dead_zone_m:.1f} m -> {after.dead_zone_m:.1f} m, "
        f"length {before.length_m:.1f} m -> {after.length_m:.1f} m"
    )
