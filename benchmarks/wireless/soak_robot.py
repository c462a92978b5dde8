"""The robot and the operator of the soak: ``python soak_robot.py robot|operator --master HOST:PORT``.

The robot drives a small round, streams small pictures and clouds, and stands in the dead zone while it is told to.
The operator commands it and counts what comes.
"""

from __future__ import annotations

import math
import sys
import time

import numpy as np

from simple_ros import aio
from simple_ros.demos.program import run_node
from simple_ros.msg.arrays import points_to_pointcloud2
from simple_ros.msg.geometry_msgs import PoseStamped, Twist
from simple_ros.msg.nav_msgs import Path
from simple_ros.msg.sensor_msgs import Image, PointCloud2
from simple_ros.msg.std_msgs import Bool, Int64
from simple_ros.qos import LATCHED
from simple_ros_hub.demo.scenery import pose_message

DEAD_ZONE = (400.0, 0.0, 30.0)
_SHAPE = (48, 64)


class Robot:
    def __init__(self, node: aio.NodeHandle) -> None:
        self.node = node
        self.is_dead = False
        self.seen = 0

    async def open(self) -> None:
        node = self.node
        self.poses = await node.advertise("/robot/pose", PoseStamped)
        self.camera = await node.advertise("/camera/image_raw", Image)
        self.lidar = await node.advertise("/lidar/points", PointCloud2)
        await node.subscribe("/soak/dead", Bool, self.told, qos=LATCHED)
        await node.subscribe("/cmd_vel", Twist, lambda _: None)
        node.create_timer(0.1, lambda _: self.move())
        node.create_timer(0.2, lambda _: self.sense())

    def told(self, message: Bool) -> None:
        self.is_dead = message.data

    def stamped(self, message):
        message.header.stamp.FromNanoseconds(self.node.clock.now().nanoseconds)
        return message

    def move(self) -> None:
        angle = 0.1 * (time.monotonic() % 62.83)
        x, y = (30 + 10 * math.cos(angle), 10 * math.sin(angle))
        if self.is_dead:
            x, y = DEAD_ZONE[:2]
        self.poses.publish(self.stamped(pose_message((x, y, angle))))

    def sense(self) -> None:
        self.seen += 1
        rows, columns = _SHAPE
        pixels = bytes([self.seen % 256]) * (3 * rows * columns)
        image = Image(height=rows, width=columns, encoding="rgb8", step=3 * columns, data=pixels)
        image.header.frame_id = "camera"
        self.camera.publish(self.stamped(image))
        if self.seen % 2:
            points = np.random.default_rng(self.seen).uniform(-5, 5, (300, 3)).astype(np.float32)
            self.lidar.publish(self.stamped(points_to_pointcloud2(points)))


class Operator:
    def __init__(self, node: aio.NodeHandle) -> None:
        self.node = node
        self.came = {"pictures": 0, "clouds": 0, "tracks": 0}

    async def open(self) -> None:
        node = self.node
        for topic, kind, name in (
            ("/camera/cell/image_raw", Image, "pictures"),
            ("/lidar/cell/points", PointCloud2, "clouds"),
            ("/telemetry/track", Path, "tracks"),
        ):
            await node.subscribe(topic, kind, lambda _, name=name: self.count(name))
        self.commands = await node.advertise("/cmd_vel/remote", Twist)
        self.counts = {name: await node.advertise(f"/soak/{name}", Int64) for name in self.came}
        node.create_timer(0.2, lambda _: self.command())
        node.create_timer(0.5, lambda _: self.tell())

    def count(self, name: str) -> None:
        self.came[name] += 1

    def command(self) -> None:
        twist = Twist()
        twist.linear.x = 1.0
        self.commands.publish(twist)

    def tell(self) -> None:
        for name, publisher in self.counts.items():
            publisher.publish(Int64(data=self.came[name]))


if __name__ == "__main__":
    role = {"robot": Robot, "operator": Operator}[sys.argv.pop(1)]

    async def main(master: str | None) -> None:
        async with aio.NodeHandle(f"soak_{role.__name__.lower()}", master=master) as node:
            await role(node).open()
            await node.spin()

    run_node(__doc__, main)
