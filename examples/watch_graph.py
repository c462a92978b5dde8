"""The graph as it changes: a node joins, publishes and leaves."""

import asyncio

from simple_ros import GraphSnapshot, aio
from simple_ros.msg.std_msgs import String


async def watch(watching: asyncio.Event) -> None:
    async with aio.MasterClient() as master:
        async for item in master.watch_graph():
            if isinstance(item, GraphSnapshot):
                print(f"{len(item.nodes)} nodes at first")
                watching.set()
            else:
                print(f"{item.kind.value}: {item.node} {item.key.topic if item.key else ''}")
                if item.kind.value == "node_removed":
                    return


async def main() -> None:
    watching = asyncio.Event()
    watcher = asyncio.create_task(watch(watching))
    await watching.wait()
    async with aio.NodeHandle("visitor") as node:
        await node.advertise("greeting", String)
    await watcher


aio.run(main())
