"""Names, namespaces and remaps of nodes that talk to each other."""

from __future__ import annotations

import asyncio
import logging

import pytest
from support.processes import program
from support.waiting import until

from simple_ros.aio import NodeHandle
from simple_ros.arguments import Arguments
from simple_ros.errors import InvalidName
from simple_ros.msg.std_msgs import String
from simple_ros.msg.std_srvs import SetBool, SetBoolRequest, SetBoolResponse
from simple_ros_master import Master


async def test_topics_are_in_the_namespace(master: Master) -> None:
    async with (
        NodeHandle("talker", master=master.address, namespace="/robot1") as talker,
        NodeHandle("listener", master=master.address) as listener,
    ):
        assert (talker.name, talker.namespace) == ("robot1/talker", "robot1")
        got: list[str] = []
        await listener.subscribe("/robot1/chatter", String, lambda m: got.append(m.data))
        await listener.subscribe("chatter", String, lambda m: got.append("global " + m.data))
        await listener.subscribe("robot1/talker/own", String, lambda m: got.append("own " + m.data))
        for topic in ("chatter", "/chatter", "~own"):
            publisher = await talker.advertise(topic, String)
            await publisher.wait_for_subscribers(1, 30)
            publisher.publish(String(data=topic))
        await until(lambda: len(got) == 3)
        assert sorted(got) == ["chatter", "global /chatter", "own ~own"]


async def test_services_too(master: Master) -> None:
    words = Arguments.parse("driver:go:=~start")
    async with (
        NodeHandle("driver", master=master.address, namespace="r", arguments=words) as driver,
        NodeHandle("tool", master=master.address) as tool,
    ):
        server = await driver.advertise_service(
            "go", SetBool, lambda request: SetBoolResponse(success=request.data)
        )
        assert server.name == "r/driver/start"
        client = tool.service_client("/r/driver/start", SetBool, timeout=30)
        assert (await client.call(SetBoolRequest(data=True))).success


async def test_remaps_bring_nodes_together(master: Master) -> None:
    words = Arguments.parse("talker:chatter:=/news listener:__ns:=r listener:~in:=/news")
    async with (
        NodeHandle("talker", master=master.address, arguments=words) as talker,
        NodeHandle("listener", master=master.address, arguments=words) as listener,
    ):
        subscriber = await listener.subscribe("~in", String)
        publisher = await talker.advertise("chatter", String)
        assert publisher.topic == subscriber.topic == "news"
        publisher.publish(String(data="hello"))
        assert (await asyncio.wait_for(subscriber.receive(), 30)).data == "hello"


async def test_a_bad_name_is_shown_with_a_caret(master: Master) -> None:
    async with NodeHandle("n", master=master.address, namespace="r") as node:
        with pytest.raises(InvalidName, match=r"'~a-b'\n +\^"):
            await node.advertise("~a-b", String)


def test_the_log_level_that_is_told() -> None:
    before = logging.getLogger().level
    try:
        NodeHandle("n", arguments=Arguments.parse("__log_level:=Debug"))
        assert logging.getLogger().level == logging.DEBUG
        NodeHandle("n", arguments=Arguments.parse("__log_level:=warn"))
        assert logging.getLogger().level == logging.WARNING
    finally:
        logging.getLogger().setLevel(before)


async def test_two_nodes_of_one_process(master: Master) -> None:
    text = """
    import argparse
    import simple_ros
    from simple_ros import NodeHandle, SystemManager
    from simple_ros.msg.std_msgs import String

    parser = argparse.ArgumentParser()
    parser.add_argument("--rate", type=int)
    options = parser.parse_args(simple_ros.argv()[1:])
    system = SystemManager.instance()
    system.init("first")
    first, second = NodeHandle(), NodeHandle("second")
    topics = [node.advertise("chatter", String).topic for node in (first, second)]
    print(options.rate, first.name, second.name, *topics)
    heard = []
    first.subscribe("~in", String, lambda message: heard.append(message.data))
    second.advertise("/r/one/in", String).publish(String(data="hello"))
    while not heard:
        system.spin_once(0.1)
    print(*heard)
    """
    words = ("__ns:=r", "--rate", "5", "__name:=one", "second:chatter:=/news")
    async with program(text, *words, master=master.address) as process:
        assert await process.line() == "5 r/one r/second r/chatter news"
        assert await process.line() == "hello"
        assert await process.wait() == 0
