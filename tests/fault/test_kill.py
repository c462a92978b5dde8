"""Processes that die, stop and come back while messages flow."""

from __future__ import annotations

import asyncio
import signal
from contextlib import AsyncExitStack

from support.processes import Process, master_process, program
from support.waiting import Stopwatch, until

from simple_ros.aio import NodeHandle
from simple_ros.graph import TopicKey
from simple_ros.msg.example import SensorData
from simple_ros_master import Master

PUBLISHER = """
    import itertools, sys
    from simple_ros import aio
    from simple_ros.msg.example import SensorData

    async def main():
        async with aio.NodeHandle("source") as node:
            publisher = await node.advertise("sensor", SensorData, qos=int(sys.argv[1]))
            counter = itertools.count()
            def tick(event):
                for _ in range(10):
                    publisher.publish(SensorData(sensor_id=next(counter)))
            node.create_timer(0.001, tick)
            print("ready", flush=True)
            await node.spin()

    aio.run(main())
"""
SUBSCRIBER = """
    import sys
    from simple_ros import aio
    from simple_ros.msg.example import SensorData

    async def main():
        count = 0
        def on_sensor(message):
            nonlocal count
            count += 1
            if count % 1000 == 1:
                print(count, flush=True)
        async with aio.NodeHandle(sys.argv[1]) as node:
            await node.subscribe("sensor", SensorData, on_sensor)
            print("ready", flush=True)
            await node.spin()

    aio.run(main())
"""
SENSOR = TopicKey("sensor", "example.SensorData")
SHORT, LONG = "100", "1000000"
"""Depths of PUBLISHER: one that drops what somebody cannot read, one that outlasts who stands still."""


def names(master: Master) -> set[str]:
    return {node.name for node in master.graph.snapshot().nodes}


async def test_kill_9_of_a_publisher(master: Master) -> None:
    got: list[int] = []
    async with NodeHandle("sink", master=master.address) as sink:
        subscriber = await sink.subscribe("sensor", SensorData, lambda m: got.append(m.sensor_id))
        for _ in range(2):
            got.clear()
            async with program(PUBLISHER, LONG, master=master.address) as publisher:
                await until(lambda: len(got) > 1000)
                assert got[:1000] == list(range(1000))
                watch = Stopwatch()
                publisher.signal(signal.SIGKILL)
                await until(lambda: "source" not in names(master))
                assert watch.seconds < 3.0
            await until(lambda: subscriber.publisher_count == 0)
        assert names(master) == {"sink"}


async def test_kill_9_of_a_subscriber(master: Master) -> None:
    got: list[int] = []
    async with (
        NodeHandle("source", master=master.address) as source,
        NodeHandle("sink", master=master.address) as sink,
    ):
        await sink.subscribe("sensor", SensorData, lambda m: got.append(m.sensor_id))
        publisher = await source.advertise("sensor", SensorData)
        for life in range(2):
            async with program(SUBSCRIBER, "victim", master=master.address) as victim:
                assert await victim.line() == "ready"
                await publisher.wait_for_subscribers(2, timeout=30)
                got.clear()
                for i in range(2000):
                    publisher.publish(SensorData(sensor_id=i))
                    if i == 1000:
                        watch = Stopwatch()
                        victim.signal(signal.SIGKILL)
                    if i % 10 == 0:
                        await asyncio.sleep(0)
                await until(lambda: got == list(range(2000)), "the sibling got everything")
                await until(lambda: "victim" not in names(master))
                assert watch.seconds < 3.0
                await until(lambda: len(publisher.targets) == 1, f"told in life {life}")


async def test_a_subscriber_that_stops_reading(master: Master) -> None:
    """SIGSTOP: alive for its kernel, reads nothing. It goes on where its queue begins."""
    got = 0

    def count(_: SensorData) -> None:
        nonlocal got
        got += 1

    async with (
        NodeHandle("sink", master=master.address) as sink,
        program(SUBSCRIBER, "victim", master=master.address) as victim,
    ):
        assert await victim.line() == "ready"
        subscriber = await sink.subscribe("sensor", SensorData, count)
        async with program(PUBLISHER, SHORT, master=master.address) as publisher:
            assert await victim.line() == "1"
            victim.signal(signal.SIGSTOP)
            before = got
            await until(lambda: got > before + 5000, "the sibling is not held up")
            victim.signal(signal.SIGCONT)
            for _ in range(3):
                await victim.line()
            publisher.signal(signal.SIGTERM)
            assert await publisher.wait() == 0
        assert subscriber.statistics.dropped == 0


async def test_kill_9_of_the_master_under_load() -> None:
    async with master_process() as (first, address):
        port = int(address.rsplit(":", 1)[1])
        async with (
            program(SUBSCRIBER, "victim", master=address) as subscriber,
            AsyncExitStack() as rest,
        ):
            assert await subscriber.line() == "ready"
            publisher = await rest.enter_async_context(program(PUBLISHER, LONG, master=address))
            assert await publisher.line() == "ready"
            assert await subscriber.line() == "1"
            first.signal(signal.SIGKILL)
            await first.wait()
            for _ in range(5):
                await _advances(subscriber)
            async with master_process(port), NodeHandle("late", master=address) as late:
                got: list[int] = []
                await late.subscribe("sensor", SensorData, lambda m: got.append(m.sensor_id))
                await until(lambda: len(got) > 100, "a newcomer meets the old publisher")
                assert got == list(range(got[0], got[0] + len(got)))
                await _advances(subscriber)


async def _advances(process: Process) -> None:
    assert int(await process.line()) > 1
