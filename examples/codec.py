"""Publish a dataclass of your own: a codec says how it becomes bytes.

The bytes are those of a protobuf type, so nodes without the codec, and every tool, read them as that.
"""

from dataclasses import dataclass
from math import atan2, cos, sin

from simple_ros import aio
from simple_ros.codecs import Codec, register_codec
from simple_ros.msg.geometry_msgs import Pose


@dataclass
class PlanarPose:
    """A robot on the floor: metres and radians."""

    x: float
    y: float
    yaw: float


class PlanarPoseCodec(Codec):
    """Carries a PlanarPose as a geometry_msgs.Pose."""

    def handles(self, message_class):
        return message_class is PlanarPose

    def type_name(self, message_class):
        return Pose.DESCRIPTOR.full_name

    def definition(self, message_class):
        return Pose

    def encode(self, message):
        pose = Pose()
        pose.position.x, pose.position.y = message.x, message.y
        pose.orientation.z, pose.orientation.w = sin(message.yaw / 2), cos(message.yaw / 2)
        return pose.SerializeToString()

    def decode(self, data, message_class):
        pose = Pose.FromString(data)
        yaw = 2 * atan2(pose.orientation.z, pose.orientation.w)
        return PlanarPose(pose.position.x, pose.position.y, yaw)


register_codec(PlanarPoseCodec())


async def main():
    async with aio.NodeHandle("planner") as planner, aio.NodeHandle("base") as base:
        as_dataclass = await base.subscribe("goal", PlanarPose)
        as_protobuf = await base.subscribe("goal", Pose)
        publisher = await planner.advertise("goal", PlanarPose)
        await publisher.wait_for_subscribers()
        publisher.publish(PlanarPose(1.0, 2.0, 0.5))
        goal = await as_dataclass.receive()
        print(f"as a dataclass: x {goal.x:g} y {goal.y:g} yaw {goal.yaw:.3f}")
        pose = await as_protobuf.receive()
        print(f"as protobuf: x {pose.position.x:g} y {pose.position.y:g}")


aio.run(main())
