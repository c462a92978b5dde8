"""Diagnostics between nodes, and ``simple-ros diag``."""

from __future__ import annotations

import asyncio
import json

import pytest
from support.processes import python
from support.waiting import until

from simple_ros import aio
from simple_ros.blocking import BlockingNode
from simple_ros.diagnostics import (
    ERROR,
    OK,
    WARN,
    DelayMonitor,
    DiagnosticAggregator,
    DiagnosticUpdater,
    FrequencyMonitor,
    Status,
    TopicWatch,
)
from simple_ros.diagnostics import blocking as diagnostics_blocking
from simple_ros.executor import Executor
from simple_ros.msg.diagnostic_msgs import DiagnosticArray, DiagnosticStatus
from simple_ros.msg.geometry_msgs import PointStamped
from simple_ros.msg.std_msgs import String
from simple_ros.net.loop import BackgroundLoop
from simple_ros_master import Master


class Reader:
    def __init__(self) -> None:
        self.latest: dict[str, DiagnosticStatus] = {}

    def take(self, array: DiagnosticArray) -> None:
        self.latest.update({status.name: status for status in array.status})


async def test_updater_and_aggregator(master: Master) -> None:
    async with (
        aio.NodeHandle("watcher", master=master.address) as watcher,
        aio.NodeHandle("robot", master=master.address) as robot,
    ):
        reader = Reader()
        await watcher.subscribe("diagnostics_agg", DiagnosticArray, reader.take)
        aggregator = await DiagnosticAggregator.create(
            watcher, {"Drive": ["robot: motor"]}, base="R2", period_s=0.02
        )
        async with await DiagnosticUpdater.create(robot, period_s=0.02) as updater:
            rate = FrequencyMonitor(0.001)
            rate.tick(updater.now())
            updater.add("motor", lambda status: status.summary(WARN, "warm"))
            updater.add("rate", rate, DelayMonitor())
            await until(lambda: "/R2/Drive/robot: motor" in reader.latest)
            await until(lambda: "/R2/Other/robot: rate" in reader.latest)
            assert reader.latest["/R2"].level == WARN
            updater.broadcast(ERROR, "going down")
            updater.remove("rate")
        await aggregator.close()


def test_bad_period() -> None:
    with pytest.raises(ValueError, match="period"):
        asyncio.run(_bad_period())


async def _bad_period() -> None:
    async with Master(host="127.0.0.1", port=0) as master:
        async with aio.NodeHandle("robot", master=master.address) as robot:
            await DiagnosticUpdater.create(robot, period_s=0)


async def test_topics(master: Master) -> None:
    async with (
        aio.NodeHandle("sink", master=master.address) as sink,
        aio.NodeHandle("source", master=master.address) as source,
    ):
        got: list[int] = []
        incoming: TopicWatch[PointStamped] = TopicWatch(sink)
        outgoing: TopicWatch[PointStamped] = TopicWatch(source)
        with pytest.raises(RuntimeError, match="publisher"):
            outgoing.publish(PointStamped())
        subscriber = await sink.subscribe(
            "points", PointStamped, incoming.wrap(lambda message: got.append(message.header.seq))
        )
        publisher = await source.advertise("points", PointStamped)
        incoming.of(subscriber)
        outgoing.of(publisher)
        await publisher.wait_for_subscribers(timeout=30)
        for seq in (1, 2, 4, 4):
            message = PointStamped()
            message.header.seq = seq
            message.header.stamp.GetCurrentTime()
            outgoing.publish(message)
        await until(lambda: len(got) == 4)
        for watch, peers in ((incoming, "publishers"), (outgoing, "subscribers")):
            status = Status("topic")
            watch.run(status, watch._now())
            assert status.level == OK
            values = status.values
            assert (values["messages"], values["gaps"], values["duplicates"]) == ("4", "1", "1")
            assert (values[peers], values["dropped"]) == ("1", "0")
            assert 0 <= float(values["mean age (s)"]) < 5
            assert float(values["bandwidth (B/s)"]) > 0


async def test_messages_without_header_and_bytes(master: Master) -> None:
    async with aio.NodeHandle("sink", master=master.address) as sink:
        for message in (String(data="abc"), b"12345", 7):
            watch: TopicWatch[object] = TopicWatch(sink)
            watch.count(message)
            status = Status("topic")
            watch.run(status, watch._now() + 1)
            assert status.values["messages"] == "1"
            assert "mean age (s)" not in status.values


def test_blocking_face() -> None:
    loop = BackgroundLoop()
    master = Master(host="127.0.0.1", port=0)
    loop.run(master.start())

    async def started() -> aio.NodeHandle:
        return await aio.NodeHandle("robot", master=master.address).start()

    executor = Executor()
    node = BlockingNode(loop, executor, loop.run(started()))
    got: list[DiagnosticArray] = []
    node.subscribe("diagnostics", DiagnosticArray, got.append)
    with diagnostics_blocking.DiagnosticUpdater(node, hardware_id="h", period_s=0.01) as updater:
        updater.add("motor", lambda status: status.summary(OK, "turns"))
        updater.add("other", lambda status: status.summary(OK, "too"))
        updater.remove("other")
        while not got:
            executor.spin_once(1)
        updater.broadcast(WARN, "stopping")
        while got[-1].status[0].message != "stopping":
            executor.spin_once(1)
        assert got[0].status[0].name == "robot: motor"
        assert got[0].status[0].hardware_id == "h"
        assert updater.now() > 0
    node.close()
    loop.run(master.stop())
    loop.stop()


ROBOT = """
from simple_ros import aio
from simple_ros.diagnostics import ERROR, OK, DiagnosticUpdater

async def main():
    async with aio.NodeHandle("robot") as node:
        updater = await DiagnosticUpdater.create(node, period_s=0.1)
        updater.add("motor", lambda status: status.summary(ERROR, "stuck"))
        updater.add("camera", lambda status: status.summary(OK, "sees"))
        print("ready", flush=True)
        await node.spin()

aio.run(main())
"""


async def outcome(master: Master, *words: str) -> tuple[int, str, str]:
    command = ("-m", "simple_ros.cli.main", "diag", *words)
    async with python(*command, SIMPLE_ROS_MASTER=master.address) as process:
        out, errors = await process.process.communicate()
        return await process.wait(), out.decode(), errors.decode()


async def test_command_line(master: Master) -> None:
    async with python("-c", ROBOT, SIMPLE_ROS_MASTER=master.address) as robot:
        assert await robot.line() == "ready"
        plain, found, nothing = await asyncio.gather(
            outcome(master, "-n", "1"),
            outcome(master, "-n", "1", "--json", "--level", "warn"),
            outcome(master, "-n", "1", "wheel"),
        )
    lines = [line.split() for line in plain[1].splitlines() if line]
    assert lines[0] == ["level", "name", "message", "age"]
    assert lines[1][:4] == ["error", "robot:", "motor", "stuck"]
    assert lines[2][:4] == ["ok", "robot:", "camera", "sees"]
    (motor,) = json.loads(found[1])
    assert (motor["level"], motor["name"]) == ("error", "robot: motor")
    assert nothing[1] == "no diagnostics\n"
