"""Two robots run the same program, each in a namespace of its own; a remap joins them."""

import asyncio

from simple_ros import Arguments, aio
from simple_ros.msg.std_msgs import String


async def robot(words: str, stop: asyncio.Event) -> None:
    """The program of a robot; words come from its command line, if none are given here."""
    async with aio.NodeHandle("driver", arguments=Arguments.parse(words)) as node:
        publisher = await node.advertise("status", String)
        speed = await node.declare_parameter("~speed", 1.0)
        print(f"{node.name} publishes {publisher.topic} at {speed} m/s", flush=True)
        publisher.publish(String(data=f"{node.name} is ready"))
        await stop.wait()


async def main() -> None:
    stop = asyncio.Event()
    async with asyncio.TaskGroup() as robots, aio.NodeHandle("base") as base:
        first = await base.subscribe("robot1/status", String)
        second = await base.subscribe("/fleet/status", String)
        robots.create_task(robot("__ns:=/robot1 _speed:=2", stop))
        print((await first.receive()).data, flush=True)
        robots.create_task(robot("__ns:=/robot2 status:=/fleet/status", stop))
        print((await second.receive()).data, flush=True)
        stop.set()


aio.run(main())
