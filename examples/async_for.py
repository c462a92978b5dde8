"""A subscription as an asynchronous iterator: read three messages, then leave."""

from simple_ros import aio
from simple_ros.msg.std_msgs import Int32


async def main() -> None:
    async with aio.NodeHandle("reader") as node:
        publisher = await node.advertise("numbers", Int32)
        numbers = await node.subscribe("numbers", Int32)
        for number in range(5):
            publisher.publish(Int32(data=number))
        async for message in numbers:
            print(f"got {message.data}")
            if message.data == 2:
                break


aio.run(main())
