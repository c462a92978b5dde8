"""What the robot of the demo drives through and sees: a route, a map, pictures, points. SIMULATED; pure."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from simple_ros.msg.arrays import numpy_to_occupancy_grid, points_to_pointcloud2
from simple_ros.msg.geometry_msgs import PoseStamped
from simple_ros.msg.nav_msgs import OccupancyGrid, Path
from simple_ros.msg.sensor_msgs import Image, PointCloud2

__all__ = [
    "DEAD_ZONE",
    "FRAME",
    "ROUTE",
    "Course",
    "cloud",
    "dead_shares",
    "floor_map",
    "lap_m",
    "picture",
    "planned_path",
    "pose_message",
]

FRAME = "map"
ROUTE = ((10.0, 5.0), (80.0, 5.0), (80.0, 35.0), (10.0, 35.0), (10.0, 5.0))
"""A round; waypoints in metres. The station stands at the origin."""
DEAD_ZONE = (50.0, 35.0, 6.0)
"""Middle and radius of a place where little arrives, in metres."""
_CELL_M = 1.0
_SIZE_M = (100, 50)
_CORNER_M = (-5.0, -5.0)
_PATH_ABOVE_M = 0.1
_PIXELS = (320, 240)
_POINTS = 3000


def lap_m() -> float:
    """Length of the round, metres."""
    return sum(math.dist(a, b) for a, b in pairwise(ROUTE))


class Course:
    """Where the robot is on its round.

    Attributes:
        way_m: Driven since the start, metres.
    """

    def __init__(self) -> None:
        self.way_m = 0.0

    @property
    def laps(self) -> float:
        """Rounds since the start, with their fraction."""
        return self.way_m / lap_m()

    def drive(self, speed_mps: float, seconds: float) -> None:
        """Go on."""
        self.way_m += max(0.0, speed_mps) * seconds

    def place(self) -> tuple[float, float, float]:
        """Where: x and y in metres, heading in radians."""
        rest = self.way_m % lap_m()
        for start, end in pairwise(ROUTE):
            leg = math.dist(start, end)
            if rest <= leg:
                part = rest / leg
                x = start[0] + part * (end[0] - start[0])
                y = start[1] + part * (end[1] - start[1])
                return x, y, math.atan2(end[1] - start[1], end[0] - start[0])
            rest -= leg
        return (*ROUTE[-1], 0.0)


def dead_shares() -> tuple[float, float]:
    """Between which shares of a round the robot is in the dead zone."""
    course = Course()
    inside = []
    while course.laps < 1:
        x, y, _ = course.place()
        if math.dist((x, y), DEAD_ZONE[:2]) <= DEAD_ZONE[2]:
            inside.append(course.laps)
        course.way_m += 0.5
    return inside[0], inside[-1]


def pose_message(place: tuple[float, float, float]) -> PoseStamped:
    """A place as a message, without a stamp."""
    x, y, heading = place
    message = PoseStamped()
    message.header.frame_id = FRAME
    message.pose.position.x, message.pose.position.y = x, y
    message.pose.orientation.z = math.sin(heading / 2)
    message.pose.orientation.w = math.cos(heading / 2)
    return message


def planned_path() -> Path:
    """The round as a path, a little above the floor: lines in the plane of a map are hidden by it."""
    path = Path()
    path.header.frame_id = FRAME
    path.poses.extend(pose_message((x, y, 0.0)) for x, y in ROUTE)
    for pose in path.poses:
        pose.pose.position.z = _PATH_ABOVE_M
    return path


def floor_map() -> OccupancyGrid:
    """Walls around, and what the radio does not get through."""
    cells = np.zeros((_SIZE_M[1], _SIZE_M[0]), np.int8)
    cells[[0, -1], :] = cells[:, [0, -1]] = 100
    cells[18:30, 40:62] = 100
    grid = numpy_to_occupancy_grid(cells, _CELL_M)
    grid.header.frame_id = FRAME
    grid.info.origin.position.x, grid.info.origin.position.y = _CORNER_M
    return grid


def picture(place: tuple[float, float, float], number: int) -> Image:
    """What the camera sees: tiles that go by, and the noise of a sensor."""
    width, height = _PIXELS
    x, y, _ = place
    columns, rows = np.arange(width), np.arange(height)[:, None]
    tiles = ((columns + int(40 * x)) // 40 + (rows + int(40 * y)) // 40) % 2
    canvas = np.empty((height, width, 3), np.int16)
    canvas[:, :, 0] = 90 + 100 * tiles
    canvas[:, :, 1] = 60 + rows * 120 // height
    canvas[:, :, 2] = 60 + columns * 120 // width
    noise = np.random.default_rng(number).integers(-8, 9, (height, width, 1))
    data = np.clip(canvas + noise, 0, 255).astype(np.uint8).tobytes()
    message = Image(width=width, height=height, step=3 * width, encoding="rgb8", data=data)
    message.header.frame_id = "camera"
    return message


def cloud(place: tuple[float, float, float], number: int) -> PointCloud2:
    """What the lidar sees: the walls around, in the frame of the map."""
    x, y, _ = place
    chance = np.random.default_rng(number)
    angles = chance.uniform(0, 2 * np.pi, _POINTS)
    ways = 12.0 + chance.normal(0, 0.05, _POINTS)
    points = np.stack(
        [x + ways * np.cos(angles), y + ways * np.sin(angles), chance.uniform(0, 2, _POINTS)], 1
    )
    message = points_to_pointcloud2(points.astype(np.float32))
    message.header.frame_id = FRAME
    return message
