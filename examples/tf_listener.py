"""Frames: where is the camera, and where is what it sees? Run tf_broadcaster.py as well."""

import asyncio
import math

from simple_ros import aio
from simple_ros.msg.geometry_msgs import PointStamped
from simple_ros.msg.std_msgs import Header
from simple_ros.tf import TransformListener


async def main() -> None:
    async with aio.NodeHandle("watcher") as node:
        buffer = (await TransformListener.create(node)).buffer
        while True:
            pose = await buffer.wait_for_transform("odom", "camera", timeout=10)
            place = pose.transform.translation
            print(f"the camera is {math.hypot(place.x, place.y):.2f} m from the start", flush=True)
            seen = PointStamped(header=Header(frame_id="camera"))
            seen.header.stamp.CopyFrom(pose.header.stamp)
            seen.point.x = 1.0
            ahead = buffer.transform(seen, "odom").point
            print(f"what it sees is {math.hypot(ahead.x, ahead.y):.2f} m from it", flush=True)
            await asyncio.sleep(0.1)


aio.run(main())
