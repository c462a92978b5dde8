"""A publisher and a timer: says hello ten times a second."""

from simple_ros import TimerEvent, aio
from simple_ros.msg.std_msgs import String


async def main() -> None:
    async with aio.NodeHandle("talker") as node:
        publisher = await node.advertise("chatter", String)
        count = 0

        def tick(event: TimerEvent) -> None:
            nonlocal count
            count += 1
            publisher.publish(String(data=f"hello {count}"))

        node.create_timer(0.1, tick)
        await node.spin()


aio.run(main())
