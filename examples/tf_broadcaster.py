"""Frames: a camera that is fixed to a robot, and the robot that drives in a circle."""

import math

from simple_ros import TimerEvent, aio
from simple_ros.clock import Clock
from simple_ros.msg.geometry_msgs import TransformStamped
from simple_ros.msg.std_msgs import Header
from simple_ros.tf import StaticTransformBroadcaster, TransformBroadcaster


def camera_on_robot() -> TransformStamped:
    transform = TransformStamped(header=Header(frame_id="base_link"), child_frame_id="camera")
    transform.transform.translation.x = 0.2
    transform.transform.rotation.w = 1
    return transform


async def main() -> None:
    async with aio.NodeHandle("driver") as node:
        clock = Clock.attach(node)
        fixed = await StaticTransformBroadcaster.create(node)
        fixed.send(camera_on_robot())
        moving = await TransformBroadcaster.create(node)

        def tick(event: TimerEvent) -> None:
            now = clock.now()
            angle = now.seconds % (2 * math.pi)
            robot = TransformStamped(header=Header(frame_id="odom"), child_frame_id="base_link")
            robot.header.stamp.CopyFrom(now.to_msg())
            robot.transform.translation.x = math.cos(angle)
            robot.transform.translation.y = math.sin(angle)
            robot.transform.rotation.z = math.sin(angle / 2)
            robot.transform.rotation.w = math.cos(angle / 2)
            moving.send(robot)

        node.create_timer(0.02, tick)
        await node.spin()


aio.run(main())
