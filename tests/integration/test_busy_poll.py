"""A loop that is kept awake: everything works, and it sleeps again when the last node is closed."""

from __future__ import annotations

import asyncio
import sys
from typing import Any

import pytest

from simple_ros.aio import NodeHandle
from simple_ros.msg.example import SensorData
from simple_ros.net.busy import BusyPoll
from simple_ros_master.server import Master


async def waits() -> set[bool]:
    """Whether the loop sleeps while nothing happens for a while: what it asks the kernel for."""
    loop: Any = asyncio.get_running_loop()
    select, found = loop._selector.select, set()

    def watched(timeout: float | None) -> Any:
        found.add(timeout != 0)
        return select(timeout)

    loop._selector.select = watched
    await asyncio.sleep(0.02)
    loop._selector.select = select
    return found


async def test_messages_pass_and_the_loop_sleeps_again(master: Master) -> None:
    loop = asyncio.get_running_loop()
    async with NodeHandle("a", master=master.address, busy_poll=True) as a:
        async with NodeHandle("b", master=master.address, busy_poll=True) as b:
            subscriber = await b.subscribe("topic", SensorData)
            publisher = await a.advertise("topic", SensorData)
            await publisher.wait_for_subscribers(1, timeout=30)
            for number in range(20):
                publisher.publish(SensorData(sensor_id=number))
                assert (await subscriber.receive_within(30)).sensor_id == number
        assert BusyPoll.of(loop).is_on
        assert await waits() == {False}
    assert not BusyPoll.of(loop).is_on
    assert True in await waits()


@pytest.mark.parametrize(("text", "is_on"), [("1", True), ("0", False), ("", False)])
async def test_the_environment_says_it_for_all_nodes(
    master: Master, monkeypatch: pytest.MonkeyPatch, text: str, is_on: bool
) -> None:
    monkeypatch.setenv("SIMPLE_ROS_BUSY_POLL", text)
    async with NodeHandle("a", master=master.address):
        assert BusyPoll.of(asyncio.get_running_loop()).is_on is is_on
    async with NodeHandle("b", master=master.address, busy_poll=False):
        assert not BusyPoll.of(asyncio.get_running_loop()).is_on


async def test_taking_it_back_at_once_and_asking_again_turns_one_wheel_only() -> None:
    poll = BusyPoll.of(asyncio.get_running_loop())
    for _ in range(3):
        poll.acquire()
        poll.release()
    assert not poll.is_on
    before = sys.getswitchinterval()
    poll.acquire()
    await asyncio.sleep(0)
    assert poll.is_on
    assert sys.getswitchinterval() < before, "other threads are let in sooner"
    poll.release()
    assert sys.getswitchinterval() == before
