"""Brakes when something is near, and ends when it has."""

from simple_ros import aio
from simple_ros.msg.std_msgs import Float32


async def main() -> None:
    async with aio.NodeHandle("brake") as node:
        async for message in await node.subscribe("range", Float32):
            if message.data < 0.5:
                print(f"{node.name}: brake at {message.data:.1f} m")
                return


aio.run(main())
