"""``simple-ros topic hz``, ``bw`` and ``delay`` on real flows."""

from __future__ import annotations

import asyncio
import json
import os
import pty
import signal
import sys
import time
from collections.abc import AsyncIterator

import pytest
from google.protobuf.timestamp_pb2 import Timestamp
from support.cli import PROGRAM, flowing, following, register, run
from support.processes import Process, python
from support.waiting import until

from simple_ros.aio import NodeHandle
from simple_ros.cli.delays import Way
from simple_ros.cli.topic.delaying import way_from
from simple_ros.msg.std_msgs import Header, String
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros_master import Master

pytestmark = pytest.mark.usefixtures("patient_master")


@pytest.fixture
async def node(master: Master) -> AsyncIterator[NodeHandle]:
    async with NodeHandle("robot", master=master.address) as node:
        yield node


async def measured(process: Process) -> str:
    """The first line that tells a measurement."""
    while (line := await process.line()) in (
        "no new messages",
        "not enough messages yet",
        "no message with a stamp yet",
    ):
        pass
    return line


class TestOneTopic:
    async def test_measurements_a_second(self, master: Master, node: NodeHandle) -> None:
        publisher = await node.advertise("header", Header)
        stamp = Timestamp()
        stamp.FromNanoseconds(time.time_ns() - 3600 * 10**9)
        at = ("header", "--master", master.address)
        async with (
            following("topic", "hz", *at) as hz,
            following("topic", "bw", *at) as bw,
            following("topic", "delay", *at) as delay,
            following("topic", "hz", "--window", "5", "--json", *at) as hz_json,
        ):
            await publisher.wait_for_subscribers(4)
            async with flowing(publisher, Header(stamp=stamp, frame_id="base")):
                assert "Hz, period min " in await measured(hz)
                assert "/s, size mean " in await measured(bw)
                assert (await measured(delay)).startswith("delay mean 36")
                # On a busy machine messages may come in bursts: a second later they do not.
                facts = json.loads(await hz_json.line())
                while facts["window"] < 5 or not 10 < facts["rate_hz"] < 200:
                    facts = json.loads(await hz_json.line())
            while await hz.line() != "no new messages":
                pass

    async def test_as_the_cpp_tool(self, master: Master, node: NodeHandle) -> None:
        publisher = await node.advertise("chatter", String)
        command = ("topic", "hz", "chatter", "--format", "cpp", "--master", master.address)
        async with python(*PROGRAM, *command) as hz:
            await publisher.wait_for_subscribers(1)
            assert hz.process.stdout is not None
            async with flowing(publisher, String(data="x")):
                shown = await hz.process.stdout.readuntil(b" Hz   ")
            assert shown.startswith(b"\rAverage rate (")
            assert b" samples): " in shown
            await hz.process.stdout.readuntil(b" Hz   ")  # goes on when nothing comes


class TestSeveralTopics:
    async def test_lines(self, master: Master, node: NodeHandle) -> None:
        publisher = await node.advertise("chatter", String)
        await node.advertise("map", String)
        at = ("--master", master.address)
        async with (
            following("topic", "hz", "/chatter", "map", *at) as hz,
            following("topic", "bw", "--all", "--json", *at) as bw,
        ):
            await publisher.wait_for_subscribers(2)
            async with flowing(publisher, String(data="x")):
                while not (line := await hz.line()).startswith("chatter  rate "):
                    assert line.split("  ")[0] in ("chatter", "map    ", "map")
                assert await hz.line() == "map      no new messages"
                facts = json.loads(await bw.line())
                while facts["window"] < 2:  # the flow had just begun
                    facts = json.loads(await bw.line())
        assert facts.pop("bytes_per_s") > 0
        assert facts.pop("window") > 1
        assert facts == {"topic": "chatter", "mean_bytes": 3.0, "min_bytes": 3, "max_bytes": 3}

    async def test_a_table_in_a_terminal(self, master: Master, node: NodeHandle) -> None:
        publisher = await node.advertise("chatter", String)
        await node.advertise("map", String)
        ours, theirs = pty.openpty()
        try:
            child = await asyncio.create_subprocess_exec(
                sys.executable,
                *(*PROGRAM, "topic", "hz", "--all", "--master", master.address),
                stdout=theirs,
                env=os.environ | {"TERM": "xterm", "COLUMNS": "100"},
            )
            await publisher.wait_for_subscribers(1, 30)
            async with flowing(publisher, String(data="x")):
                shown = await seen(ours, "Hz", "max period", "chatter", "no new messages")
            assert "\x1b[?25l" in shown  # the cursor is hidden while the table stands
            child.send_signal(signal.SIGINT)
            assert await child.wait() == 0
            await seen(ours, "\x1b[?25h")
        finally:
            os.close(ours)
            os.close(theirs)

    async def test_names_or_all(self, master: Master) -> None:
        for arguments in ((), ("--all", "a"), ("a", "b", "--format", "cpp")):
            code, _, stderr = await run("topic", "hz", *arguments)
            assert (code, "Invalid value" in stderr) == (2, True)
        none = await run("topic", "bw", "--all", "--master", master.address)
        assert none == (1, "", "error: the Master lists no topics\n")

    async def test_a_name_that_breaks_the_rules_is_left_out(
        self, master: Master, node: NodeHandle
    ) -> None:
        info = ros.NodeInfo(node_name="theirs", ip="127.0.0.1", port=node.port)
        await register(master.address, info, topic="a\x1b[2Jb")
        await node.advertise("chatter", String)
        async with python(*PROGRAM, "topic", "hz", "--all", "--master", master.address) as hz:
            assert await hz.line() == "no new messages"
            hz.signal(signal.SIGINT)
            assert await hz.wait() == 0
            warning = await hz.errors()
            assert warning.startswith("warning: a topic is left out: topic name ")
            assert "\x1b" not in warning


async def seen(terminal: int, *texts: str) -> str:
    """What a terminal shows, once it has shown all of these."""
    shown = ""
    os.set_blocking(terminal, False)

    def has_all() -> bool:
        nonlocal shown
        try:
            shown += os.read(terminal, 65536).decode()
        except BlockingIOError:
            pass
        return all(text in shown for text in texts)

    await until(has_all, f"{texts} on the terminal")
    return shown


class TestDelayBetweenHosts:
    def stamp(self, age_s: float) -> Header:
        stamp = Timestamp()
        stamp.FromNanoseconds(time.time_ns() - round(age_s * 1e9))
        return Header(stamp=stamp)

    async def test_the_way_is_measured(
        self, node: NodeHandle, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        here = ros.NodeInfo(node_name="robot", ip="127.0.0.1", port=node.port)
        assert await way_from([here, here], node.master) == Way(is_local=True)
        assert await way_from([], node.master) == Way(problem="nobody publishes")
        far = ros.NodeInfo(node_name="far", ip="192.0.2.1", port=1)
        for nodes in ([here, far], [far, ros.NodeInfo(ip="192.0.2.2")]):
            several = Way(problem="publishers are on several hosts")
            assert await way_from(nodes, node.master) == several
        monkeypatch.setattr("simple_ros.cli.topic.delaying.is_this_host", lambda ip, master: False)
        found = await way_from([here], node.master)
        assert found.round_trip_s is not None
        assert 0 < found.round_trip_s < 1

    async def test_a_given_offset_is_subtracted(self, master: Master, node: NodeHandle) -> None:
        publisher = await node.advertise("header", Header)
        command = ("topic", "delay", "header", "--offset", "3600", "--json")
        async with following(*command, "--master", master.address) as delay:
            await publisher.wait_for_subscribers(1)
            async with flowing(publisher, self.stamp(3600)):
                facts = json.loads(await delay.line())
        assert (facts["topic"], facts["clocks"], facts["offset"]) == ("header", "same", "given")
        assert 3600e3 <= facts["min_ms"] < 3660e3
        assert 0 <= facts["corrected_min_ms"] < 60e3

    async def test_auto_says_when_it_cannot(self, master: Master, node: NodeHandle) -> None:
        publisher = await node.advertise("header", Header)
        far = ros.NodeInfo(node_name="far", ip="192.0.2.1", port=60000)
        await register(master.address, far, "std_msgs.Header", "header")
        command = ("topic", "delay", "header", "--offset", "auto", "--master", master.address)
        async with python(*PROGRAM, *command) as delay:
            await publisher.wait_for_subscribers(1)
            async with flowing(publisher, self.stamp(-3600)):
                line = await measured(delay)
                assert line.startswith("delay mean -")
                assert (await delay.line()).startswith("  negative: the clocks differ")
            delay.signal(signal.SIGINT)
            assert await delay.wait() == 0
            assert await delay.errors() == (
                "warning: no offset can be estimated: publishers are on several hosts\n"
            )

    async def test_no_offset(self) -> None:
        code, _, stderr = await run("topic", "delay", "x", "--offset", "soon")
        assert code == 2
        assert "'soon' is neither 'none' nor 'auto'" in stderr
