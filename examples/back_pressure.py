"""Overflow: a publisher that waits for a slow subscriber instead of dropping."""

import asyncio

from simple_ros import DEFAULT, aio
from simple_ros.msg.std_msgs import Int32


async def main() -> None:
    lossless = DEFAULT.replace(depth=10, overflow="block")
    received = 0

    async def slowly(message: Int32) -> None:
        nonlocal received
        await asyncio.sleep(0.001)
        received += 1

    async with aio.NodeHandle("source") as source, aio.NodeHandle("sink") as sink:
        await sink.subscribe("numbers", Int32, slowly, qos=lossless)
        publisher = await source.advertise("numbers", Int32, qos=lossless)
        for number in range(200):
            await publisher.publish_async(Int32(data=number))
        await publisher.flush()
        while received < 200:
            await asyncio.sleep(0.01)
        print(f"received {received}, dropped {publisher.statistics.dropped}")


aio.run(main())
