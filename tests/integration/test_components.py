"""Several nodes in one process, sharing messages."""

from __future__ import annotations

import asyncio
import signal
import textwrap
from pathlib import Path

import pytest
from support.processes import python
from support.waiting import until

from simple_ros import LATCHED, ConfigError, Durability, QosProfile, QueueFull
from simple_ros.aio import NodeHandle
from simple_ros.components import Component, component, run_components
from simple_ros.engine import Engine
from simple_ros.msg.example import SensorData
from simple_ros_master.server import Master

REFERENCE = ("reference", "tcp")


class Greeter(Engine):
    node_name = "greeter"
    summary = "Says hello."

    async def run(self, node: NodeHandle) -> None:
        await node.advertise("hello", SensorData)


async def quiet(node: NodeHandle) -> None:
    await node.spin()


def plain(node: NodeHandle) -> None:
    pass


def test_what_is_a_component() -> None:
    here = "simple_ros.engine"
    assert component("asyncio:sleep").name == "sleep"
    assert component("nap=asyncio:sleep").name == "nap"
    for spec, problem in [
        ("nothing", "write module:function"),
        ("=asyncio:sleep", "write module:function"),
        ("asyncio:", "write module:function"),
        ("no_such_module:x", "cannot be loaded: No module named"),
        ("asyncio:no_such", "cannot be loaded"),
        (f"{here}:engine_named", "neither a coroutine function nor an Engine"),
    ]:
        with pytest.raises(ConfigError, match=problem):
            component(spec)


async def test_messages_are_shared_and_others_get_bytes(master: Master) -> None:
    got: list[SensorData] = []
    raw: list[bytes] = []
    away: list[SensorData] = []
    async with (
        NodeHandle("source", master=master.address, transports=REFERENCE) as source,
        NodeHandle("sink", master=master.address, transports=REFERENCE) as sink,
        NodeHandle("other", master=master.address) as other,
    ):
        other.local_peer = lambda _: None  # type: ignore[method-assign]
        publisher = await source.advertise("t", SensorData)
        await sink.subscribe("t", SensorData, got.append)
        await sink.subscribe("t", "example.SensorData", raw.append, raw=True)
        await other.subscribe("t", SensorData, away.append)
        await publisher.wait_for_subscribers(2, timeout=30)
        message = SensorData(sensor_id=7)
        publisher.publish(message)
        await until(lambda: got and raw and away)
        assert got[0] is message
        assert raw == [message.SerializeToString()]
        assert away == [message]
        publisher.publish_bytes(SensorData(sensor_id=8).SerializeToString())
        await publisher.publish_async(SensorData(sensor_id=9))
        await until(lambda: len(away) == 3 and len(got) == 3)
        assert [item.sensor_id for item in got] == [7, 8, 9]
        assert publisher.statistics.published == 3
        assert publisher.statistics.dropped == 0


async def test_references_latch_and_hold_back_as_everything_does(master: Master) -> None:
    got: list[SensorData] = []
    async with (
        NodeHandle("source", master=master.address, transports=REFERENCE) as source,
        NodeHandle("sink", master=master.address, transports=REFERENCE) as sink,
    ):
        latched = await source.advertise("map", SensorData, qos=LATCHED)
        latched.publish(SensorData(sensor_id=1))
        profile = QosProfile(durability=Durability.TRANSIENT_LOCAL)
        await sink.subscribe("map", SensorData, got.append, qos=profile)
        await until(lambda: got)
        assert got == [SensorData(sensor_id=1)]
        block = QosProfile(depth=3, overflow="block")
        subscriber = await sink.subscribe("t", SensorData, qos=block)
        publisher = await source.advertise("t", SensorData, qos=block)
        await publisher.wait_for_subscribers(1, timeout=30)
        sent = 0
        with pytest.raises(QueueFull):
            for sent in range(100):
                publisher.publish(SensorData(sensor_id=sent))
                await asyncio.sleep(0)
        assert [(await subscriber.receive_within(30)).sensor_id for _ in range(sent)] == list(
            range(sent)
        )


async def test_one_that_fails_leaves_the_others_alone(
    master: Master, caplog: pytest.LogCaptureFixture
) -> None:
    going_on = asyncio.Event()

    async def fails(node: NodeHandle) -> None:
        raise LookupError("no camera")

    async def works(node: NodeHandle) -> None:
        await until(lambda: "component 'fails' failed" in caplog.text)
        going_on.set()

    components = [Component("fails", fails), Component("works", works)]
    assert await run_components(components, master=master.address) == 1
    assert going_on.is_set()
    assert "no camera" in caplog.text
    with pytest.raises(ConfigError, match="two components are called 'works'"):
        await run_components([components[1], components[1]], master=master.address)


async def test_the_program_runs_components_with_names_and_remaps(
    master: Master, tmp_path: Path
) -> None:
    (tmp_path / "robot_nodes.py").write_text(
        textwrap.dedent("""
            from simple_ros.msg.std_msgs import String

            async def talker(node):
                publisher = await node.advertise("chatter", String)
                node.create_timer(0.02, lambda event: publisher.publish(String(data=node.name)))
                await node.spin()

            async def listener(node):
                async for message in await node.subscribe("news", String):
                    print("heard", message.data, flush=True)
        """)
    )
    words = ("robot_nodes:talker", "ear=robot_nodes:listener", "talker:chatter:=news")
    where = {"SIMPLE_ROS_MASTER": master.address, "PYTHONPATH": str(tmp_path)}
    async with (
        NodeHandle("observer", master=master.address) as observer,
        python("-m", "simple_ros.components", *words, **where) as process,
    ):
        assert await process.line() == "heard talker"
        await observer.wait_for_master(30)
        names = [node.node_name for node in await observer.client.get_nodes()]
        assert sorted(names) == ["ear", "observer", "talker"]
        process.signal(signal.SIGINT)
        assert await process.wait() == 0
    async with python("-m", "simple_ros.components", "robot_nodes:none", **where) as process:
        assert await process.wait() == 2
        assert "cannot be loaded" in await process.errors()
    bad = ("robot_nodes:talker", "ear=robot_nodes:listener", "__ns:=/r-2")
    async with python("-m", "simple_ros.components", *bad, **where) as process:
        assert await process.wait() == 2
        errors = await process.errors()
        assert errors.startswith("error: argument names a namespace that must not contain '-'")
        assert errors.endswith("\n  '__ns:=/r-2'\n           ^\n")
