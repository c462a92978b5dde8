"""Publishes ranges, and says that it is ready once it can."""

import argparse

from simple_ros import aio
from simple_ros.msg.std_msgs import Float32
from simple_ros.ready import ready


async def main(rate_hz: float) -> None:
    async with aio.NodeHandle("range_sensor") as node:
        publisher = await node.advertise("range", Float32)
        node.create_timer(1 / rate_hz, lambda event: publisher.publish(Float32(data=0.4)))
        ready()
        await node.spin()


parser = argparse.ArgumentParser()
parser.add_argument("--rate", type=float, default=10.0)
aio.run(main(parser.parse_known_args()[0].rate))
