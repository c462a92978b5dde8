from __future__ import annotations

import json
import signal
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from support.bags import make_bag, texts
from support.cli import PROGRAM, run
from support.foxglove import connected
from support.processes import Process, python
from support.waiting import until

from simple_ros import aio
from simple_ros.foxglove.reporting import STATS_TOPIC
from simple_ros.msg.std_msgs import String
from simple_ros_master import Master


@asynccontextmanager
async def foxglove(*arguments: str, **environment: str) -> AsyncIterator[tuple[Process, int]]:
    """``simple-ros foxglove`` on a free port, ended by Ctrl-C."""
    async with python(*PROGRAM, "foxglove", "--port", "0", *arguments, **environment) as process:
        line = await process.line()
        assert line.startswith("listening at ws://localhost:")
        await process.line()
        yield process, int(line.rsplit(":", 1)[1])
        if process.process.returncode is None:
            process.signal(signal.SIGINT)
        assert await process.wait() == 0


def bridges(master: Master) -> set[str]:
    names = {item.name for item in master.graph.nodes()}
    return {name for name in names if name.startswith("foxglove_bridge_")}


async def test_live_recorded_and_counted(master: Master, tmp_path: Path) -> None:
    path = tmp_path / "seen.mcap"
    arguments = ("--master", master.address, "--record", str(path), "--stats")
    async with (
        aio.NodeHandle("talker", master=master.address) as node,
        foxglove(*arguments) as (process, port),
    ):
        async with connected(port) as client:
            publisher = await node.advertise("chatter", String)
            await client.subscribe("/chatter")
            # What is recorded has a subscriber before the client is heard.
            statistics = json.loads(await process.line())
            while not statistics["subscriptions"]:
                statistics = json.loads(await process.line())
            await publisher.wait_for_subscribers(1, timeout=30)
            publisher.publish(String(data="hello"))
            await until(lambda: client.on("/chatter"))
            while not statistics["sent"]:
                statistics = json.loads(await process.line())
            assert statistics["subscriptions"] == 1
            await client.subscribe(STATS_TOPIC)
            await until(lambda: client.on(STATS_TOPIC))
            shown = client.decoder(STATS_TOPIC).FromString(client.on(STATS_TOPIC)[0])
            assert shown.status[0].name.startswith("foxglove client 127.0.0.1:")  # type: ignore[attr-defined]
        process.signal(signal.SIGINT)
        line = "{"
        while line.startswith("{"):
            line = await process.line()
        assert line == f"wrote {path}: {2} messages"
        assert await process.wait() == 0
    assert texts(path, "chatter") == ["hello"]


async def test_a_bag_without_a_master(tmp_path: Path) -> None:
    path = make_bag(tmp_path / "a.mcap", [("count", n / 100, str(n)) for n in range(50)])
    async with foxglove("--bag", str(path), "--loop") as (_, port), connected(port) as client:
        await client.subscribe("/count")
        await until(lambda: client.on("/count"))


async def test_a_token_is_not_printed(master: Master) -> None:
    where = {"SIMPLE_ROS_FOXGLOVE_TOKEN": "geheim", "SIMPLE_ROS_MASTER": master.address}
    async with python(*PROGRAM, "foxglove", "--port", "0", **where) as process:
        lines = [await process.line(), await process.line()]
        assert "geheim" not in "".join(lines)
        assert lines[1].endswith("/?token=TOKEN")


async def test_a_second_bridge_leaves_the_first_alone(master: Master) -> None:
    arguments = ("--master", master.address)
    async with foxglove(*arguments) as (_, port), connected(port) as client:
        code, _, stderr = await run("foxglove", "--port", str(port), *arguments)
        assert code == 1
        assert f"cannot listen on 127.0.0.1:{port}" in stderr
        async with foxglove(*arguments), aio.NodeHandle("a", master=master.address) as node:
            await node.advertise("chatter", String)
            await client.channel("/chatter")
            await until(lambda: len(bridges(master)) == 2, "both bridges are with the Master")


async def test_an_empty_token_lets_nobody_in(master: Master) -> None:
    code, stdout, stderr = await run(
        "foxglove", "--port", "0", "--token", "", SIMPLE_ROS_MASTER=master.address
    )
    assert (code, stdout) == (2, "")
    assert "--token is empty" in stderr


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("--topics", "("), "no regular expression"),
        (("--max-rate", "imu"), "--max-rate"),
        (("--queue", "imu=1.5"), "whole number"),
        (("--send-buffer-limit", "much"), "no size"),
        (("--asset-root", "a=/nothing/there"), "no directory"),
        (("--assets", "("), "no regular expression"),
        (("--allow-origin", "robot:8080"), "http://host:port"),
        (("--without", "colours"), "no capability 'colours'"),
        (("--bag", "/nothing/there.mcap"), "there.mcap"),
        (("--tls-cert", "/nothing/there.pem"), "there.pem"),
        (("--host", "203.0.113.1"), "cannot listen on 203.0.113.1"),
    ],
)
async def test_what_makes_no_sense(arguments: tuple[str, ...], reason: str) -> None:
    code, stdout, stderr = await run("foxglove", "--port", "0", *arguments)
    assert (code, stdout) == (1, "")
    assert stderr.startswith("error: ")
    assert stderr.count("\n") == 1
    assert reason in stderr
