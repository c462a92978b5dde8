"""Playing through a real Master: bytes, order, times, and what may be asked meanwhile."""

from __future__ import annotations

import asyncio
import os
import pty
import signal
import sys
from collections.abc import AsyncIterator
from itertools import pairwise
from pathlib import Path

import pytest
from support.bags import START_NS, make_bag, text
from support.processes import python
from support.waiting import Stopwatch, until

from simple_ros.aio import NodeHandle
from simple_ros.bag import Bag, BagWriter, NothingToPlay, Player, PlayOptions, SplitRule
from simple_ros.bag.channel_qos import metadata_of
from simple_ros.bag.plan import LatchedHistory
from simple_ros.bag.series import BagSeries, RecordedTopic, SeriesOptions
from simple_ros.msg.definitions import definition_of
from simple_ros.msg.rosgraph_msgs import Clock
from simple_ros.msg.std_msgs import String
from simple_ros.net.master_client import MasterClient
from simple_ros.qos import LATCHED
from simple_ros_master import Master

PROGRAM = ("-m", "simple_ros.cli.main", "bag", "play")
FAST = 1000.0


@pytest.fixture
async def node(master: Master) -> AsyncIterator[NodeHandle]:
    async with NodeHandle("listener", master=master.address) as node:
        yield node


@pytest.fixture
async def player_node(master: Master) -> AsyncIterator[NodeHandle]:
    async with NodeHandle("player", master=master.address) as node:
        yield node


async def heard_by(node: NodeHandle, topic: str) -> list[str]:
    """What comes on a topic from now on."""
    heard: list[str] = []
    await node.subscribe(topic, String, lambda message: heard.append(message.data))
    return heard


def numbers(count: int, period_s: float = 0.1) -> list[tuple[str, float, str]]:
    return [("numbers", index * period_s, str(index)) for index in range(count)]


async def test_bytes_and_order_by_the_command(
    master: Master, node: NodeHandle, tmp_path: Path
) -> None:
    """Of a type that is installed nowhere, under another name."""
    from integration.test_bag_record import dynamic_type

    beacon = dynamic_type()
    sent = [beacon(name=f"beacon {index}").SerializeToString() for index in range(500)]
    with BagWriter(tmp_path / "a.mcap") as writer:
        definition = definition_of(beacon).SerializeToString()
        schema = writer.add_schema("lab.Beacon", "protobuf", definition)
        channel = writer.add_channel("beacon", schema)
        for index, payload in enumerate(sent):
            writer.add(channel, START_NS + index * 1_000_000, [payload])
    got: list[bytes] = []
    await node.subscribe("light/house", "lab.Beacon", got.append, raw=True)
    path = str(tmp_path / "a.mcap")
    command = (*PROGRAM, path, "-m", "beacon:=/light/house", "-r", "5", "--master", master.address)
    async with python(*command) as process:
        assert await process.line() == "playing light/house"
        async with MasterClient(master.address) as client:
            known = await client.message_class("lab.Beacon")
            assert [field.name for field in known.DESCRIPTOR.fields] == ["name"]
        assert await process.line() == "published 500 messages"
        assert await process.wait() == 0
        assert await process.errors() == ""
    await until(lambda: len(got) == 500, "all have come")
    assert got == sent


async def test_the_pace(node: NodeHandle, player_node: NodeHandle, tmp_path: Path) -> None:
    path = make_bag(tmp_path / "a.mcap", numbers(11))
    times: list[float] = []
    loop = asyncio.get_running_loop()
    await node.subscribe("numbers", String, lambda _: times.append(loop.time()))
    period_s = 0.1 / 4.0
    with Bag(path) as bag:
        player = Player(player_node, [bag], PlayOptions(rate=4.0))
        await player.open()
        watch, begun = Stopwatch(), loop.time()
        await player.run()
        await until(lambda: len(times) == 11)
        hindered = watch.hindered
    # One second at four times its pace: none comes before its time, whatever stands still when;
    # a machine that stands still makes it longer.
    early = [begun + index * period_s - came for index, came in enumerate(times)]
    assert max(early) < 1e-3
    assert times[-1] - begun < 0.8 + hindered
    assert player.position_s == pytest.approx(player.end_s) == pytest.approx(1.0)


async def test_what_is_latched_comes_first_in_the_middle(
    node: NodeHandle, player_node: NodeHandle, tmp_path: Path
) -> None:
    # As several publishers of tf_static do, each with a message that counts.
    messages = [("map", 0.0, "one"), ("map", 0.0, "two"), ("map", 0.0, "one"), *numbers(50)]
    path = make_bag(tmp_path / "a.mcap", messages, flush_every=3, latched=["map"])
    with Bag(path) as bag:
        options = PlayOptions(rate=FAST, start_offset_s=2.0, duration_s=1.0)
        player = Player(player_node, [bag], options)
        order: list[str] = []
        # Before it advertises: then its publishers have these subscribers from the beginning.
        for topic in ("map", "numbers"):
            await node.subscribe(
                topic, String, lambda m: order.append(m.data), qos=LATCHED if topic == "map" else 1
            )
        await player.open()
        await player.run()
        await until(lambda: len(order) == 13)
        late = await node.subscribe("map", String, qos=LATCHED)
        assert (await late.receive_within(30)).data == "one"
    assert order == ["two", "one", *(str(index) for index in range(20, 31))]


async def test_pause_step_seek_and_rate(
    node: NodeHandle, player_node: NodeHandle, tmp_path: Path
) -> None:
    path = make_bag(tmp_path / "a.mcap", numbers(100, period_s=1.0), flush_every=10)
    heard = await heard_by(node, "numbers")
    with Bag(path) as bag:
        player = Player(player_node, [bag], PlayOptions(paused=True))
        await player.open()
        playing = asyncio.create_task(player.run())
        await until(lambda: player.is_paused)
        player.step()
        await until(lambda: heard == ["0"])
        player.step()
        player.step()
        await until(lambda: heard == ["0", "1", "2"])
        assert player.position_s == pytest.approx(2.0)
        player.seek(97.0)
        await until(lambda: player.position_s == pytest.approx(97.0))
        player.step()
        await until(lambda: heard[3:] == ["97"])
        player.set_rate(FAST)
        player.resume()
        await asyncio.wait_for(playing, 30)
        await until(lambda: heard[3:] == ["97", "98", "99"])


async def test_a_loop_and_the_clock(master: Master, node: NodeHandle, tmp_path: Path) -> None:
    path = make_bag(tmp_path / "a.mcap", numbers(3, period_s=0.05))
    heard = await heard_by(node, "numbers")
    stamps: list[int] = []
    await node.subscribe("clock", Clock, lambda m: stamps.append(m.clock.ToNanoseconds()))
    command = (*PROGRAM, str(path), "-l", "--clock", "--clock-rate", "200")
    async with python(*command, "--master", master.address) as process:
        await until(lambda: len(heard) >= 7 and len(stamps) >= 20)
        # The clock comes by a link of its own.
        await until(lambda: any(b < a for a, b in pairwise(stamps)), "a time that goes back")
        process.signal(signal.SIGINT)
        assert await process.wait() == 0
        assert await process.errors() == ""
    assert heard[:7] == ["0", "1", "2", "0", "1", "2", "0"]
    assert all(START_NS <= stamp <= START_NS + 10**8 for stamp in stamps)


async def test_files_of_one_recording(
    node: NodeHandle, player_node: NodeHandle, tmp_path: Path
) -> None:
    """The latched messages that each file repeats are published once."""
    series = BagSeries(SeriesOptions(tmp_path / "run.mcap", split=SplitRule(max_duration_s=0.1)))
    definition = definition_of(String).SerializeToString()
    chart = RecordedTopic(
        "numbers", "std_msgs.String", definition, metadata_of(LATCHED), LatchedHistory()
    )
    for index in range(10):
        series.add(chart, START_NS + index * 50_000_000, [text(str(index))])
    series.finish({})
    assert len(series.finished) == 5
    heard = await heard_by(node, "numbers")
    bags = [Bag(path) for path in reversed(series.finished)]
    player = Player(player_node, bags, PlayOptions(rate=FAST))
    await player.open()
    await player.run()
    await until(lambda: len(heard) >= 10)
    for bag in bags:
        bag.close()
    assert heard == [str(index) for index in range(10)]
    assert player.published == 10


async def test_what_cannot_be_played(
    node: NodeHandle, player_node: NodeHandle, tmp_path: Path
) -> None:
    with BagWriter(tmp_path / "a.mcap") as writer:
        unknown = writer.add_channel("unknown", writer.add_schema("x.Y", "", b""))
        taken = writer.add_channel(
            "taken",
            writer.add_schema(
                "std_msgs.String", "protobuf", definition_of(String).SerializeToString()
            ),
        )
        for channel in (unknown, taken):
            writer.add(channel, START_NS, [b""])
    await node.advertise("taken", Clock)
    with Bag(tmp_path / "a.mcap") as bag:
        player = Player(player_node, [bag], PlayOptions())
        with pytest.raises(NothingToPlay, match=r"unknown message type 'x\.Y'") as caught:
            await player.open()
        assert "taken" in str(caught.value)
        assert player.skipped.keys() == {"unknown", "taken"}
        nothing = Player(player_node, [bag], PlayOptions(wants=lambda _: False))
        with pytest.raises(NothingToPlay, match="no messages of the topics asked for"):
            await nothing.open()


async def test_keys_of_a_terminal(master: Master, node: NodeHandle, tmp_path: Path) -> None:
    path = make_bag(tmp_path / "a.mcap", numbers(3, period_s=1000.0))
    heard = await heard_by(node, "numbers")
    process, terminal = await in_a_terminal(str(path), "--start-paused", "--master", master.address)
    shown: list[bytes] = []
    loop = asyncio.get_running_loop()

    def readable() -> None:
        try:
            shown.append(os.read(terminal, 4096))
        except OSError:  # the other end is gone
            loop.remove_reader(terminal)

    loop.add_reader(terminal, readable)
    await until(lambda: b"paused" in b"".join(shown), "the status line")
    for count in range(1, 4):
        os.write(terminal, b"\x1b[C")
        await until(lambda count=count: len(heard) == count, "a step")  # type: ignore[misc]
    os.write(terminal, b"\x1b[A")
    os.write(terminal, b" ")
    assert await asyncio.wait_for(process.wait(), 30) == 0
    await until(lambda: b"published 3 messages" in b"".join(shown))
    loop.remove_reader(terminal)
    os.close(terminal)
    assert heard == ["0", "1", "2"]


OWN_TERMINAL = """
import fcntl, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
from simple_ros.cli.main import main
sys.argv = ["simple-ros", "bag", "play", *sys.argv[1:]]
main()
"""


async def in_a_terminal(*arguments: str) -> tuple[asyncio.subprocess.Process, int]:
    """The command with a terminal of its own, and the terminal's other side."""
    ours, theirs = pty.openpty()
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-c",
        OWN_TERMINAL,
        *arguments,
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        start_new_session=True,
    )
    os.close(theirs)
    return process, ours
