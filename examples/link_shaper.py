"""A robot's camera and an operator's stop over one simulated radio link. No radio is behind it.

The robot has 30 % of a carrier that would carry 20 Mbit/s. Ten pictures at once are more than its queue holds, and
the stop comes last; yet it arrives first. In real systems the shaper is a process of its own (`simple-ros link
shape`), and nodes come by ``SIMPLE_ROS_TRANSPORTS=local,shaped SIMPLE_ROS_SITE=robot``.
"""

import asyncio

from simple_ros import QosProfile
from simple_ros.aio import NodeHandle, run
from simple_ros.msg.sensor_msgs import CompressedImage
from simple_ros.msg.std_msgs import Empty
from simple_ros_engines.link_shaper.relay import Relay
from simple_ros_engines.link_shaper.transport import ShapedTransport
from simple_ros_engines.simulator.shaper_reading import read_settings

SETTINGS = {
    "listen": "127.0.0.1:0",
    "links": {"robot": {"up": {"rate_mbps": 20, "max_share": 0.3, "delay_ms": 10}}},
    "classes": [
        {"name": "command", "topics": ["stop"], "priority": 5, "deadline_ms": 100},
        {"name": "camera", "topics": ["camera/*"], "priority": 1, "queue_bytes": 400_000},
    ],
}


async def main():
    async with Relay(read_settings(SETTINGS)) as relay:
        robot_ways = (ShapedTransport("robot", relay.address),)
        station_ways = (ShapedTransport("station", relay.address),)
        async with (
            NodeHandle("robot", transports=robot_ways) as robot,
            NodeHandle("station", transports=station_ways) as station,
        ):
            arrived = asyncio.Event()
            order = []

            def came(what):
                order.append(what)
                arrived.set()

            await station.subscribe("camera/jpeg", CompressedImage, lambda _: came("picture"))
            await station.subscribe("stop", Empty, lambda _: came("stop"))
            camera = await robot.advertise("camera/jpeg", CompressedImage, qos=QosProfile(depth=20))
            stop = await robot.advertise("stop", Empty)
            await camera.wait_for_subscribers(1, timeout=10)
            await stop.wait_for_subscribers(1, timeout=10)

            for _ in range(10):
                camera.publish(CompressedImage(format="jpeg", data=bytes(150_000)))
            await camera.flush()
            stop.publish(Empty())
            while len(order) < 3:
                arrived.clear()
                await arrived.wait()
            print("arrived:", ", ".join(order))
            command, pictures = relay.machine.radios["up"].queues["robot"].counts[:2]
            print(f"pictures: {pictures.offered} offered, {pictures.dropped} dropped whole")
            print(f"commands late or lost: {command.missed}")


if __name__ == "__main__":
    run(main())
