"""A subscriber with a plain callback: prints what the talker says."""

from simple_ros import aio
from simple_ros.msg.std_msgs import String


def on_chatter(message: String) -> None:
    print(f"heard: {message.data}", flush=True)


async def main() -> None:
    async with aio.NodeHandle("listener") as node:
        await node.subscribe("chatter", String, on_chatter)
        await node.spin()


aio.run(main())
