"""The node ``quad_visualizer``: turns where a quadrotor is into shapes and lines to draw."""

from __future__ import annotations

import time
from collections import deque

from simple_ros import aio
from simple_ros.demos.program import run_node
from simple_ros.demos.quadrotor_markers import (
    PATH_POINTS,
    propeller_angle_rad,
    quadrotor_markers,
    short_path_marker,
    step_marker,
)
from simple_ros.msg.geometry_msgs import Odometry, Point
from simple_ros.msg.visualization_msgs import Marker, MarkerArray


async def main(master: str | None = None) -> None:
    """Publish shapes and lines for every `Odometry` on ``quad_odometry`` until cancelled."""
    async with aio.NodeHandle("quad_visualizer", master=master) as node:
        shapes = await node.advertise("quad_marker_array", MarkerArray)
        short_path = await node.advertise("quad_path_short", Marker)
        steps = await node.advertise("quad_path_incremental", Marker)
        path: deque[Point] = deque(maxlen=PATH_POINTS)

        def draw(message: Odometry) -> None:
            path.append(message.pose.position)
            angle_rad = propeller_angle_rad(time.monotonic())
            shapes.publish(quadrotor_markers(message.pose, angle_rad))
            short_path.publish(short_path_marker(path))
            if len(path) > 1:
                steps.publish(step_marker(path[-2], path[-1]))

        await node.subscribe("quad_odometry", Odometry, draw)
        await node.spin()


if __name__ == "__main__":
    run_node("Turn a quadrotor's odometry into shapes and lines to draw.", main)
