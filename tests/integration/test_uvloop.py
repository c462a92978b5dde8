"""Everything that has a transport of its own, on uvloop."""

from __future__ import annotations

import textwrap

import pytest
from support.processes import python
from support.waiting import until

from simple_ros.aio import NodeHandle
from simple_ros.large import LargeMessage, large
from simple_ros.msg.example import SensorData
from simple_ros.msg.sensor_msgs import Image
from simple_ros.msg.std_srvs import Trigger, TriggerRequest, TriggerResponse
from simple_ros_master import Master

uvloop = pytest.importorskip("uvloop", reason="uvloop is not installed")


@pytest.mark.parametrize(
    "transports", [("tcp",), ("unix", "tcp"), ("shm", "tcp"), ("local", "tcp")]
)
def test_topics_large_messages_and_services(transports: tuple[str, ...]) -> None:
    kind = large(Image)
    small: list[SensorData] = []
    images: list[LargeMessage[Image]] = []

    async def scenario() -> None:
        async with (
            Master(port=0) as master,
            NodeHandle("a", master=master.address, transports=transports) as a,
            NodeHandle("b", master=master.address, transports=transports) as b,
        ):
            await b.subscribe("image", kind, images.append)
            await b.subscribe("sensor", SensorData, small.append)
            camera = await a.advertise("image", kind)
            sensor = await a.advertise("sensor", SensorData)
            await camera.wait_for_subscribers(1, timeout=30)
            await sensor.wait_for_subscribers(1, timeout=30)
            for number in range(5):
                await camera.publish_async(kind(Image(height=number), bytes(3_000_000)))
            for number in range(200):
                await sensor.publish_async(SensorData(sensor_id=number))
            await until(lambda: len(images) == 5 and len(small) == 200)
            # Two nodes of one loop would call each other directly.
            b.providers._local_lanes = lambda _: None
            await a.advertise_service("s", Trigger, lambda _: TriggerResponse(message="done"))
            answer = await b.service_client("s", Trigger).call(TriggerRequest(), timeout=30)
            assert answer.message == "done"

    uvloop.run(scenario())
    assert [image.height for image in images] == list(range(5))
    assert [message.sensor_id for message in small] == list(range(200))


PROGRAM = """
    import asyncio
    from simple_ros import aio

    async def main():
        print(type(asyncio.get_running_loop()).__module__)

    aio.run(main())
"""
BLOCKING = """
    from simple_ros import NodeHandle, SystemManager
    from simple_ros.msg.example import SensorData

    node = NodeHandle("alone")
    got = []
    node.subscribe("sensor", SensorData, got.append)
    publisher = node.advertise("sensor", SensorData)
    while not got:
        publisher.publish(SensorData(sensor_id=3))
        SystemManager.instance().spin_once()
    print(got[0].sensor_id)
    SystemManager.instance().shutdown()
"""


@pytest.mark.parametrize(
    ("wanted", "module"),
    [
        ("uvloop", "uvloop"),
        ("asyncio", "asyncio.unix_events"),
        ("", "simple_ros.net.quick_loop"),
    ],
)
async def test_the_environment_chooses_the_loop(wanted: str, module: str) -> None:
    async with python("-c", textwrap.dedent(PROGRAM), SIMPLE_ROS_LOOP=wanted) as process:
        assert await process.line() == module
        assert await process.wait() == 0


async def test_another_loop_is_an_error_that_says_which_there_are() -> None:
    async with python("-c", textwrap.dedent(PROGRAM), SIMPLE_ROS_LOOP="trio") as process:
        assert await process.wait() == 1
        assert (
            await process.errors()
            == "SIMPLE_ROS_LOOP=trio: there are 'quick', 'asyncio' and 'uvloop'\n"
        )


async def test_blocking_programs_take_it_too(master: Master) -> None:
    environment = {"SIMPLE_ROS_LOOP": "uvloop", "SIMPLE_ROS_MASTER": master.address}
    async with python("-c", textwrap.dedent(BLOCKING), **environment) as process:
        assert await process.line() == "3"
        assert await process.wait() == 0
