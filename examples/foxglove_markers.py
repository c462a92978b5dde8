"""Foxglove: shapes for the 3D panel, which shows /shapes/scene (start ``simple-ros foxglove``, too)."""

import math

from simple_ros import TimerEvent, aio
from simple_ros.msg import visualization_msgs as vis
from simple_ros.msg.geometry_msgs import Point, Pose, Quaternion, Vector3
from simple_ros.msg.std_msgs import Header
from simple_ros.msg.visualization_msgs import ColorRGBA, Marker, MarkerArray

PERIOD_S = 0.05
WORLD = Header(frame_id="world")
ORANGE = ColorRGBA(r=1.0, g=0.6, b=0.1, a=1.0)
WHITE = ColorRGBA(r=1.0, g=1.0, b=1.0, a=1.0)


def shapes_at(angle: float) -> MarkerArray:
    hand = Marker(header=WORLD, ns="clock", id=0, type=vis.ARROW, color=ORANGE)
    hand.points.extend([Point(), Point(x=math.cos(angle), y=math.sin(angle))])
    hand.scale.CopyFrom(Vector3(x=0.05, y=0.12, z=0.2))
    label = Marker(header=WORLD, ns="clock", id=1, type=vis.TEXT_VIEW_FACING, color=WHITE)
    label.pose.CopyFrom(Pose(position=Point(z=0.4), orientation=Quaternion(w=1.0)))
    label.scale.z = 0.15
    label.text = f"{math.degrees(angle) % 360:.0f} degrees"
    spark = Marker(header=WORLD, ns="spark", type=vis.SPHERE, color=WHITE)
    spark.pose.position.CopyFrom(hand.points[1])
    spark.scale.CopyFrom(Vector3(x=0.1, y=0.1, z=0.1))
    spark.lifetime = 0.5
    return MarkerArray(markers=[hand, label, spark])


async def main() -> None:
    async with aio.NodeHandle("clock_hand") as node:
        shapes = await node.advertise("shapes", MarkerArray)
        print("publishing shapes; the 3D panel shows them as /shapes/scene")
        step = 0

        def tick(event: TimerEvent) -> None:
            nonlocal step
            step += 1 + event.skipped
            shapes.publish(shapes_at(step * PERIOD_S))

        node.create_timer(PERIOD_S, tick)
        await node.spin()


aio.run(main())
