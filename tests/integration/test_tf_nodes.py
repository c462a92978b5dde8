"""Transforms between nodes, waiting for them, and ``simple-ros tf``."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest
from support.processes import python
from support.waiting import until

from simple_ros import aio
from simple_ros.blocking import BlockingNode
from simple_ros.clock import CLOCK_TOPIC, Clock
from simple_ros.executor import Executor
from simple_ros.msg.geometry_msgs import Point, PointStamped, TransformStamped
from simple_ros.msg.rosgraph_msgs import Clock as ClockMsg
from simple_ros.msg.tf2_msgs import TFMessage
from simple_ros.net.loop import BackgroundLoop
from simple_ros.tf import (
    Buffer,
    ExtrapolationException,
    InvalidArgument,
    LookupException,
    StaticTransformBroadcaster,
    TransformBroadcaster,
    TransformListener,
    TransformTimeout,
)
from simple_ros.tf import blocking as tf_blocking
from simple_ros.time import Time
from simple_ros_master import Master


def edge(parent: str, child: str, seconds: float, x: float = 0.0) -> TransformStamped:
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id = parent
    message.header.stamp.CopyFrom(Time.of(seconds).to_msg())
    message.transform.translation.x = x
    message.transform.rotation.w = 1
    return message


@asynccontextmanager
async def nodes(master: Master, *names: str) -> AsyncIterator[list[aio.NodeHandle]]:
    made = [await aio.NodeHandle(name, master=master.address).start() for name in names]
    try:
        yield made
    finally:
        for node in made:
            await node.close()


async def test_static_transforms_reach_who_comes_late(master: Master) -> None:
    async with nodes(master, "robot", "late") as (robot, late):
        static = await StaticTransformBroadcaster.create(robot)
        static.send(edge("base", "camera", 0, 1))
        static.send([edge("base", "laser", 0, 2), edge("base", "camera", 0, 3)])
        async with await TransformListener.create(late) as listener:
            laser = await listener.buffer.wait_for_transform("base", "laser", timeout=30)
            assert laser.transform.translation.x == 2
            camera = listener.buffer.lookup_transform("base", "camera", Time.of(1e9))
            assert camera.transform.translation.x == 3
        await static.close()


async def test_waiting_for_a_time(master: Master) -> None:
    async with nodes(master, "robot", "planner") as (robot, planner):
        broadcaster = await TransformBroadcaster.create(robot)
        buffer = (await TransformListener.create(planner)).buffer
        assert not buffer.can_transform("odom", "base")
        waiting = asyncio.create_task(
            buffer.wait_for_transform("odom", "base", Time.of(1.5), timeout=30)
        )
        await broadcaster._publisher.wait_for_subscribers(timeout=30)
        broadcaster.send(edge("odom", "base", 1, 1))
        await until(lambda: buffer.can_transform("odom", "base"))
        assert not waiting.done()
        broadcaster.send(edge("odom", "base", 2, 2))
        assert (await waiting).transform.translation.x == pytest.approx(1.5)
        assert buffer.latest_common_time("odom", "base") == Time.of(2)
        assert buffer.frames() == ("base", "odom")
        assert buffer.facts()[0].parent == "odom"
        message = PointStamped(point=Point(x=1))
        message.header.frame_id = "base"
        message.header.stamp.CopyFrom(Time.of(1.25).to_msg())
        moved = buffer.transform(message, "odom")
        assert moved.point.x == pytest.approx(2.25)
        assert moved.header.frame_id == "odom"
        full = buffer.lookup_transform_full("base", Time.of(2), "base", Time.of(1), "odom")
        assert full.transform.translation.x == pytest.approx(-1)
        await broadcaster.close()


async def test_waiting_in_vain() -> None:
    buffer = Buffer()
    with pytest.raises(TransformTimeout, match="no transform has come yet") as caught:
        await buffer.wait_for_transform("a", "b", timeout=0.01)
    assert isinstance(caught.value, TimeoutError)
    assert isinstance(caught.value.reason, LookupException)
    buffer.set_transform(edge("a", "b", 1))
    with pytest.raises(TransformTimeout) as caught:
        await buffer.wait_for_transform("a", "b", Time.of(9), timeout=0.01)
    assert isinstance(caught.value.reason, ExtrapolationException)
    with pytest.raises(InvalidArgument):
        await buffer.wait_for_transform("a", "/b", timeout=9)
    with pytest.raises(TransformTimeout):
        buffer.wait_for_transform_blocking("a", "c", timeout=0.01)
    with pytest.raises(TypeError, match="no header"):
        buffer.transform(Point(), "a")  # type: ignore[type-var]


async def test_what_makes_no_sense(master: Master, caplog: pytest.LogCaptureFixture) -> None:
    async with nodes(master, "robot", "other") as (robot, other):
        broadcaster = await TransformBroadcaster.create(robot)
        with pytest.raises(InvalidArgument, match="length 0"):
            broadcaster.send(TransformStamped(child_frame_id="b", header={"frame_id": "a"}))
        publisher = await robot.advertise("tf", TFMessage)
        listener = await TransformListener.create(other)
        await publisher.wait_for_subscribers(timeout=30)
        for _ in range(2):
            publisher.publish(TFMessage(transforms=[edge("a", "a", 1), edge("a", "b", 1)]))
        await until(lambda: listener.refused == 2)
        assert listener.buffer.can_transform("a", "b")
        assert caplog.text.count("cannot be its own parent") == 1


async def test_time_that_goes_back_empties_the_buffer(master: Master) -> None:
    async with nodes(master, "robot", "other") as (robot, other):
        Clock.attach(other).use_sim_time(True)
        clock = await robot.advertise(CLOCK_TOPIC, ClockMsg)
        await clock.wait_for_subscribers(timeout=30)
        buffer = (await TransformListener.create(other)).buffer
        clock.publish(ClockMsg(clock=Time.of(10).to_msg()))
        await until(lambda: Clock.attach(other).now() == Time.of(10))
        buffer.set_transform(edge("a", "b", 10))
        buffer.set_transform(edge("b", "c", 0), is_static=True)
        clock.publish(ClockMsg(clock=Time.of(1).to_msg()))
        await until(lambda: not buffer.can_transform("a", "b"))
        assert buffer.can_transform("b", "c")


def test_blocking_face() -> None:
    loop = BackgroundLoop()
    master = Master(host="127.0.0.1", port=0)
    loop.run(master.start())

    async def started(name: str) -> aio.NodeHandle:
        return await aio.NodeHandle(name, master=master.address).start()

    robot, planner = (
        BlockingNode(loop, Executor(), loop.run(started(name))) for name in ("robot", "planner")
    )
    with (
        tf_blocking.TransformListener(planner) as listener,
        tf_blocking.StaticTransformBroadcaster(robot) as static,
        tf_blocking.TransformBroadcaster(robot) as broadcaster,
    ):
        static.send(edge("base", "camera", 0, 1))
        stop = threading.Event()

        def drive() -> None:
            number = 0
            while not stop.wait(0.01):
                number += 1
                broadcaster.send(edge("odom", "base", number / 100, number))

        thread = threading.Thread(target=drive)
        thread.start()
        answer = listener.wait_for_transform("odom", "camera", timeout=30)
        stop.set()
        thread.join()
        assert answer.transform.translation.x >= 2
        assert listener.refused == 0
    robot.close()
    planner.close()
    loop.run(master.stop())
    loop.stop()


ROBOT = """
import asyncio
from simple_ros import aio
from simple_ros.msg.geometry_msgs import TransformStamped
from simple_ros.tf import StaticTransformBroadcaster, TransformBroadcaster
from simple_ros.time import Time

def edge(parent, child, x=0.0):
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id = parent
    message.header.stamp.GetCurrentTime()
    message.transform.translation.x = x
    message.transform.rotation.w = 1
    return message

async def main():
    async with aio.NodeHandle("robot") as node:
        static = await StaticTransformBroadcaster.create(node)
        static.send([edge("base", "camera", 0.5), edge("world", "cup")])
        moving = await TransformBroadcaster.create(node)
        node.create_timer(0.02, lambda event: moving.send(edge("odom", "base", 2.0)))
        print("ready", flush=True)
        await node.spin()

aio.run(main())
"""


async def outcome(master: Master, *words: str) -> tuple[int, str, str]:
    async with python(
        "-m", "simple_ros.cli.main", *words, SIMPLE_ROS_MASTER=master.address
    ) as process:
        out, errors = await process.process.communicate()
        return await process.wait(), out.decode(), errors.decode()


async def test_command_line(master: Master) -> None:
    async with python("-c", ROBOT, SIMPLE_ROS_MASTER=master.address) as robot:
        assert await robot.line() == "ready"
        # Long enough to see all of it although the robot stands still for a while.
        trees, dot, found, echoed, wrong, monitored = await asyncio.gather(
            outcome(master, "tf", "tree", "--duration", "2.5"),
            outcome(master, "tf", "tree", "--duration", "2.5", "--dot"),
            outcome(master, "tf", "tree", "--duration", "2.5", "--json"),
            outcome(master, "tf", "echo", "odom", "camera", "-n", "2", "--rate", "50"),
            outcome(master, "tf", "echo", "odom", "camrea", "--timeout", "2.5"),
            outcome(master, "tf", "monitor", "-n", "1"),
        )
    assert trees[0] == 0, trees
    lines = trees[1].splitlines()
    assert lines[0] == "odom"
    assert lines[1].startswith("└─ base")
    assert "Hz" in lines[1]
    assert lines[2].split() == ["└─", "camera", "static"]
    # Who stands still while transforms come in finds that they are late, and says that, too.
    assert "(!) there are 2 trees, with the roots 'odom', 'world'" in lines
    assert '"odom" -> "base" [label=' in dot[1]
    value = json.loads(found[1])
    assert value["roots"] == ["odom", "world"]
    assert {frame["frame"] for frame in value["frames"]} == {"base", "camera", "cup"}
    assert echoed[1].count("translation  x 2.5000  y 0.0000  z 0.0000 m") == 2
    assert wrong[0] == 1
    assert (
        "error: not within 2.5 s: frame 'camrea' does not exist; did you mean 'camera'" in wrong[2]
    )
    assert monitored[1].splitlines()[0].split() == [
        "frame",
        "parent",
        "rate",
        "delay",
        "max",
        "delay",
        "age",
    ]


async def test_command_line_with_nothing_to_see(master: Master) -> None:
    tree, found = await asyncio.gather(
        outcome(master, "tf", "tree", "--duration", "0.1"),
        outcome(master, "tf", "tree", "--duration", "0.1", "--json"),
    )
    assert tree[0] == 1
    assert tree[2] == "error: no transform came within 0.1 s on 'tf' and 'tf_static'\n"
    assert json.loads(found[1]) == {"roots": [], "frames": [], "problems": []}


async def test_echo_tells_how_long_it_waited(master: Master) -> None:
    code, _, errors = await outcome(master, "tf", "echo", "a", "b", "--timeout", "1.2")
    assert code == 1
    first, last = errors.splitlines()
    assert first.startswith("waiting: frame 'a' does not exist")
    assert last.startswith("error: not within 1.2 s: frame 'a' does not exist")
