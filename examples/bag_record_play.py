"""A bag: record a topic while it is published, then play it back to somebody else, ten times as fast."""

import asyncio
import tempfile
from pathlib import Path

from simple_ros import aio
from simple_ros.bag import Bag, Player, PlayOptions, Recorder, SeriesOptions, TopicSelection
from simple_ros.msg.std_msgs import Int32


async def record(path: Path) -> None:
    async with aio.NodeHandle("recorder") as node, aio.NodeHandle("counter") as counter:
        async with Recorder(node, TopicSelection.made(["count"]), SeriesOptions(path)) as recorder:
            publisher = await counter.advertise("count", Int32)
            await publisher.wait_for_subscribers()
            for number in range(5):
                publisher.publish(Int32(data=number))
                await asyncio.sleep(0.1)
            summary = await recorder.stop()
        print(f"recorded {summary.messages} messages, dropped {sum(summary.drops.values())}")


async def play(path: Path) -> None:
    async with aio.NodeHandle("player") as node, aio.NodeHandle("listener") as listener:
        with Bag(path) as bag:
            player = Player(node, [bag], PlayOptions(rate=10, remap={"count": "replayed"}))
            await player.open()
            counts = await listener.subscribe("replayed", Int32)
            await player.run()
            for _ in range(player.published):
                print(f"heard {(await counts.receive()).data}")


async def main() -> None:
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "count.mcap"
        await record(path)
        await play(path)


aio.run(main())
