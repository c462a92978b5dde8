"""The robot of the demo as a program: drives its round at the speed it is told, streams what it sees.

``python -m simple_ros_hub.demo.robot --master HOST:PORT``; the environment says at which site it is.
"""

from __future__ import annotations

from google.protobuf.message import Message

from simple_ros import aio
from simple_ros.demos.program import run_node
from simple_ros.msg.geometry_msgs import PoseStamped, Twist
from simple_ros.msg.nav_msgs import OccupancyGrid, Path
from simple_ros.msg.sensor_msgs import Image, PointCloud2
from simple_ros.msg.std_msgs import Float32
from simple_ros.qos import LATCHED, QosProfile
from simple_ros_hub.demo.scenery import (
    Course,
    cloud,
    floor_map,
    picture,
    planned_path,
    pose_message,
)

__all__ = ["main"]

POSE_S = 0.05
_SENSED_S = 0.1
_CREEP_MPS = 1.0
"""Out of a place where nobody can command it, the robot gets by itself."""
_SENT = QosProfile(depth=5)


class Robot:
    """The robot's node.

    Args:
        node: Started.
    """

    def __init__(self, node: aio.NodeHandle) -> None:
        self._node = node
        self._course = Course()
        self._speed_mps = 0.0
        self._seen = 0

    async def open(self) -> None:
        """Advertise, subscribe, drive."""
        advertise = self._node.advertise
        self._poses = [
            await advertise(topic, PoseStamped, qos=_SENT)
            for topic in ("/robot/pose", "/plain/pose")
        ]
        self._progress = await advertise("/wireless_demo/progress", Float32)
        self._camera = await advertise("/camera/image_raw", Image, qos=_SENT)
        self._lidar = await advertise("/lidar/points", PointCloud2, qos=_SENT)
        map_out = await advertise("/map", OccupancyGrid, qos=LATCHED)
        map_out.publish(floor_map())
        path_out = await advertise("/planned_path", Path, qos=LATCHED)
        path_out.publish(planned_path())
        for topic in ("/cmd_vel", "/plain/cmd_vel"):
            await self._node.subscribe(topic, Twist, self._command)
        self._node.create_timer(POSE_S, lambda _: self._move())
        self._node.create_timer(_SENSED_S, lambda _: self._sense())

    def _command(self, message: Twist) -> None:
        self._speed_mps = message.linear.x

    def _stamped(self, message: Message) -> Message:
        message.header.stamp.FromNanoseconds(self._node.clock.now().nanoseconds)  # type: ignore[attr-defined]
        return message

    def _move(self) -> None:
        self._course.drive(max(_CREEP_MPS, self._speed_mps), POSE_S)
        pose = pose_message(self._course.place())
        self._stamped(pose)
        for publisher in self._poses:
            publisher.publish(pose)
        self._progress.publish(Float32(data=self._course.laps))

    def _sense(self) -> None:
        self._seen += 1
        place = self._course.place()
        if self._camera.subscriber_count:
            image = picture(place, self._seen)
            self._stamped(image)
            self._camera.publish(image)
        if self._lidar.subscriber_count:
            points = cloud(place, self._seen)
            self._stamped(points)
            self._lidar.publish(points)


async def main(master: str | None) -> None:
    """Drive until asked to end."""
    async with aio.NodeHandle("wireless_robot", master=master) as node:
        await Robot(node).open()
        await node.spin()


if __name__ == "__main__":
    run_node("The robot of the wireless demo.", main)
