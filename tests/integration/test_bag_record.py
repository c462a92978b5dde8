"""Recording through a real Master: what is written, and what is left when things go wrong."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from google.protobuf import descriptor_pb2
from support.bags import texts
from support.processes import Process, python
from support.waiting import Stopwatch, until

from simple_ros.aio import NodeHandle, Publisher
from simple_ros.bag import Bag, Recorder, SeriesOptions, TopicSelection
from simple_ros.bag.channel_qos import profile_in
from simple_ros.bag.examination import examine
from simple_ros.bag.information import inspect
from simple_ros.bag.series import DROPS, RECORDING
from simple_ros.msg.definitions import message_class
from simple_ros.msg.rosgraph_msgs import Clock
from simple_ros.msg.std_msgs import Float64, Int64, String
from simple_ros.qos import LATCHED, SENSOR_DATA
from simple_ros_master import Master

PROGRAM = ("-m", "simple_ros.cli.main", "bag")


@pytest.fixture
async def node(master: Master) -> AsyncIterator[NodeHandle]:
    async with NodeHandle("robot", master=master.address) as node:
        yield node


@asynccontextmanager
async def recording(master: Master, *arguments: str) -> AsyncIterator[Process]:
    """``simple-ros bag record``, which has said where it writes."""
    command = (*PROGRAM, "record", *arguments, "--min-free", "0", "--master", master.address)
    async with python(*command) as process:
        assert (await process.line()).startswith("recording into ")
        yield process


async def run(*arguments: str) -> tuple[int, str, str]:
    async with python(*PROGRAM, *arguments) as process:
        assert process.process.stdout is not None
        stdout = (await process.process.stdout.read()).decode()
        return await process.wait(), stdout, await process.errors()


async def until_recorded(publisher: Publisher[Any]) -> None:
    await publisher.wait_for_subscribers(1, timeout=30)


async def ended(process: Process, number: signal.Signals = signal.SIGINT) -> str:
    """What is printed last."""
    process.signal(number)
    assert process.process.stdout is not None
    lines = (await process.process.stdout.read()).decode().splitlines()
    assert await process.wait() == 0
    return lines[-1]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
async def test_what_was_published_is_in_the_file(
    master: Master, node: NodeHandle, tmp_path: Path, number: signal.Signals
) -> None:
    urdf = tmp_path / "robot.urdf"
    urdf.write_text("<robot/>")
    chart = await node.advertise("map", String, qos=LATCHED)
    chart.publish(String(data="the map"))
    path = tmp_path / "drive.mcap"
    arguments = ("-a", "-x", "secret", "-o", str(tmp_path / "drive"), "--attach", str(urdf))
    async with recording(master, *arguments, "--custom-data", "run=7") as process:
        # These begin while it records.
        chatter = await node.advertise("chatter", String, qos=SENSOR_DATA)
        secret = await node.advertise("secret/key", String)
        await until_recorded(chatter)
        await until_recorded(chart)
        for index in range(100):
            chatter.publish(String(data=str(index)))
            secret.publish(String(data="no"))
        last = os.urandom(20_000).hex()
        chatter.publish(String(data=last))
        active = tmp_path / "drive.mcap.active"
        await until(lambda: active.stat().st_size > 20_000, "the last message is on the disk")
        assert await ended(process, number) == f"wrote {path}: 102 messages, " + size_of(path)
    assert texts(path, "chatter") == [*(str(index) for index in range(100)), last]
    assert texts(path, "map") == ["the map"]
    assert not active.exists()
    with Bag(path) as bag:
        topics = {topic.name: topic for topic in bag.topics.values()}
        facts = bag.metadata()
        assert bag.attachment_names == ["robot.urdf"]
        assert [(item.media_type, item.data) for item in bag.attachments()] == [
            ("application/xml", b"<robot/>")
        ]
    assert topics.keys() == {"map", "chatter"}
    assert topics["map"].is_latched
    assert profile_in(topics["map"].metadata) == LATCHED
    assert profile_in(topics["chatter"].metadata).depth == SENSOR_DATA.depth
    assert facts["custom"] == {"run": "7"}
    assert facts[RECORDING].keys() >= {"host", "user", "version", "command", "started"}
    assert DROPS not in facts


def size_of(path: Path) -> str:
    return f"{path.stat().st_size / 1000:.2f} kB"


async def test_a_killed_recorder_loses_no_more_than_the_last_second(
    master: Master, node: NodeHandle, tmp_path: Path
) -> None:
    # All that comes while the recorder stands still has room to wait.
    publisher = await node.advertise("load", Int64, qos=100_000)
    noise = await node.advertise("noise", String)
    published: list[float] = []
    padding = String(data="x" * 20_000)

    async def load() -> None:
        while True:
            for _ in range(20):
                published.append(time.monotonic())
                publisher.publish(Int64(data=len(published)))
            noise.publish(padding)
            await asyncio.sleep(0.005)

    path, fixed = tmp_path / "run.mcap", tmp_path / "fixed.mcap"
    active = tmp_path / "run.mcap.active"
    async with recording(master, "load", "noise", "-o", str(path)) as process:
        await until_recorded(publisher)
        loading = asyncio.create_task(load())
        sizes = {active.stat().st_size}
        while len(sizes) < 3:  # it was flushed twice
            await until(lambda: active.stat().st_size not in sizes, "a flush")
            sizes.add(active.stat().st_size)
        watch = Stopwatch()
        await asyncio.sleep(0.5)  # in the middle between two flushes
        process.signal(signal.SIGKILL)
        killed, hindered = time.monotonic(), watch.hindered
        await process.wait()
        loading.cancel()
    code, stdout, stderr = await run("info", str(active))
    assert code == 1
    assert "is it still being recorded?" in stderr
    assert f"'simple-ros bag recover {active} OUT.mcap'" in stderr
    code, stdout, stderr = await run("recover", str(active), str(fixed))
    assert (code, stderr) == (0, "")
    assert "the recording was not ended" in stdout
    with Bag(fixed) as bag:
        numbers = [Int64.FromString(message.data).data for message in bag.messages(["load"])]
    assert numbers == list(range(1, len(numbers) + 1))
    assert killed - published[len(numbers) - 1] - hindered < 1.0
    assert examine(fixed).errors == []


async def test_types_that_are_not_installed(
    master: Master, node: NodeHandle, tmp_path: Path
) -> None:
    beacon = dynamic_type()
    publisher = await node.advertise("beacon", beacon)
    path = tmp_path / "a.mcap"
    async with recording(master, "beacon", "-o", str(path)) as process:
        assert await process.line() == "  beacon  lab.Beacon"
        await until_recorded(publisher)
        publisher.publish(beacon(name="north"))
        await publisher.flush()
        assert (await ended(process)).startswith(f"wrote {path}: 1 message, ")
    with Bag(path) as bag:
        (message,) = bag.messages()
        assert message.decoded().name == "north"  # type: ignore[attr-defined]


def dynamic_type() -> Any:
    file = descriptor_pb2.FileDescriptorProto(name="lab.proto", package="lab", syntax="proto3")
    part = file.message_type.add(name="Beacon")
    kinds = descriptor_pb2.FieldDescriptorProto
    part.field.add(name="name", number=1, type=kinds.TYPE_STRING, label=kinds.LABEL_OPTIONAL)
    return message_class(descriptor_pb2.FileDescriptorSet(file=[file]), "lab.Beacon")


async def test_a_topic_that_changes_its_type(
    master: Master, node: NodeHandle, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async with NodeHandle("recorder", master=master.address) as own:
        options = SeriesOptions(tmp_path / "a.mcap")
        async with Recorder(own, TopicSelection.made(every=True), options) as recorder:
            first = await node.advertise("value", String)
            await until_recorded(first)
            first.publish(String(data="1"))
            await until(lambda: [t.received for t in recorder.topics] == [1])
            await first.close()
            await until(lambda: not master.graph.types_of("value"), "the topic is free again")
            second = await node.advertise("value", Float64)
            await until_recorded(second)
            second.publish(Float64(data=2.0))
            await until(lambda: [t.received for t in recorder.topics] == [1, 1])
            summary = await recorder.stop()
    assert "both are recorded" in caplog.text
    assert (summary.messages, summary.drops, summary.failure) == (2, {}, None)
    with Bag(tmp_path / "a.mcap") as bag:
        assert [(m.topic.name, m.topic.msg_type) for m in bag.messages()] == [
            ("value", "std_msgs.String"),
            ("value", "std_msgs.Float64"),
        ]


async def test_drops_are_counted(
    master: Master, node: NodeHandle, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    publisher = await node.advertise("flood", String)
    async with NodeHandle("recorder", master=master.address) as own:
        recorder = Recorder(
            own,
            TopicSelection.made(["flood"]),
            SeriesOptions(tmp_path / "a.mcap"),
            max_cache_bytes=10,
        )
        await until_recorded(publisher)
        count = 0
        while not recorder.drops:
            publisher.publish(String(data="x" * 100))
            count += 1
            await asyncio.sleep(0)
        await publisher.flush()
        (topic,) = recorder.topics
        await until(lambda: topic.received + topic.dropped == count, "all have come")
        summary = await recorder.stop()
    assert summary.drops == {"flood": topic.dropped}
    assert summary.messages == topic.received == count - topic.dropped
    assert caplog.text.count("dropping messages of 'flood'") == 1
    (found,) = inspect(tmp_path / "a.mcap").topics
    assert (found.count, found.dropped) == (topic.received, topic.dropped)


async def test_pausing_and_simulated_time(master: Master, node: NodeHandle, tmp_path: Path) -> None:
    publisher = await node.advertise("chatter", String)
    stamp = 17
    async with NodeHandle("recorder", master=master.address) as own:
        recorder = Recorder(
            own,
            TopicSelection.made(["chatter"]),
            SeriesOptions(tmp_path / "a.mcap"),
            clock=lambda: stamp,
            paused=True,
        )
        await until_recorded(publisher)
        witness = await own.subscribe("chatter", String)
        publisher.publish(String(data="unheard"))
        await witness.receive()
        recorder.is_paused = False
        publisher.publish(String(data="heard"))
        await witness.receive()
        await recorder.stop()
    with Bag(tmp_path / "a.mcap") as bag:
        assert [(m.log_time, String.FromString(m.data).data) for m in bag.messages()] == [
            (17, "heard")
        ]


async def test_times_of_the_clock_topic(master: Master, node: NodeHandle, tmp_path: Path) -> None:
    clock = await node.advertise("clock", Clock, qos=LATCHED)
    chatter = await node.advertise("chatter", String)
    path = tmp_path / "a.mcap"
    command = ("record", "chatter", "-o", str(path), "--use-sim-time", "--min-free", "0")
    async with python(*PROGRAM, *command, "--master", master.address) as process:
        assert await process.line() == "waiting for /clock"
        message = Clock()
        message.clock.FromNanoseconds(5 * 10**9)
        clock.publish(message)
        assert (await process.line()).startswith("recording into ")
        await until_recorded(chatter)
        chatter.publish(String(data="x"))
        await chatter.flush()
        await ended(process)
    with Bag(path) as bag:
        assert [message.log_time for message in bag.messages()] == [5 * 10**9]


async def test_a_snapshot_of_the_last_messages(
    master: Master, node: NodeHandle, tmp_path: Path
) -> None:
    chatter = await node.advertise("chatter", String)
    path = tmp_path / "a.mcap"
    async with recording(master, "chatter", "--snapshot-mode", "-o", str(path)) as process:
        await until_recorded(chatter)
        assert (await process.line()).startswith("  chatter")
        async with NodeHandle("witness", master=master.address) as witness:
            heard = await witness.subscribe("chatter", String)
            await chatter.wait_for_subscribers(2)
            for data in ("a", "b"):
                chatter.publish(String(data=data))
                await heard.receive()
        count = 0
        # The witness has a link of its own: what it has heard may be on its way to the recorder.
        while count < 2:
            process.signal(signal.SIGUSR1)
            words = (await process.line()).split()
            assert words[:2] == ["snapshot", "of"]
            count += int(words[2])
        await ended(process)
    assert texts(path) == ["a", "b"]


# -- disks that fill up --------------------------------------------------------------------------

LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
from simple_ros.cli.main import main
sys.argv = ["simple-ros", *sys.argv[1:]]
main()
"""


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    path = tmp_path / "disk"
    path.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(path)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        pytest.skip("there is no 'mount'")
    if done.returncode:
        pytest.skip(f"a small file system needs root: {done.stderr.strip()}")
    yield path
    subprocess.run(["umount", str(path)], check=True)


async def test_a_full_disk_ends_the_file(
    master: Master, node: NodeHandle, small_disk: Path
) -> None:
    await record_until_full(master, node, small_disk, ("-m", "simple_ros.cli.main"))


async def test_a_file_that_may_not_grow_ends(
    master: Master, node: NodeHandle, tmp_path: Path
) -> None:
    await record_until_full(master, node, tmp_path, ("-c", LIMITED))


async def record_until_full(
    master: Master, node: NodeHandle, directory: Path, program: tuple[str, ...]
) -> None:
    publisher = await node.advertise("noise", String)
    path = directory / "a.mcap"
    command = ("bag", "record", "noise", "-o", str(path), "--min-free", "0", "--chunk-size", "20kB")
    async with python(*program, *command, "--master", master.address) as process:
        await until_recorded(publisher)

        async def load() -> None:
            while True:
                publisher.publish(String(data=os.urandom(1000).hex()))
                await asyncio.sleep(0.001)

        loading = asyncio.create_task(load())
        assert await process.wait() == 1
        loading.cancel()
        stderr = await process.errors()
        assert f"error: {path}.active: cannot write on: " in stderr
        assert "Traceback" not in stderr
    found = examine(path)
    assert found.errors == []
    assert found.messages > 50
    assert not path.with_name("a.mcap.active").exists()


# -- the command ---------------------------------------------------------------------------------


async def test_mistakes_are_told(master: Master, tmp_path: Path) -> None:
    at = ("--master", master.address)
    existing = tmp_path / "there.mcap"
    existing.write_text("")
    answers = await asyncio.gather(
        run("record", *at),
        run("record", "-a", "-o", str(existing), *at),
        run("record", "-a", "-o", str(tmp_path / "no" / "x.mcap"), *at),
        run("record", "-a", "-o", str(tmp_path / "x.mcap"), "--master", "127.0.0.1:1"),
        run("record", "-e", "(", *at),
        run("record", "-a", "--attach", str(tmp_path / "none"), *at),
    )
    assert [code for code, _, _ in answers] == [2, 1, 1, 1, 1, 1]
    errors = [stderr for _, _, stderr in answers]
    assert "name topics, or -a for all" in errors[0]
    assert errors[1] == f"error: {existing} exists; choose another name or remove it\n"
    assert "there is no directory" in errors[2]
    assert "no Master answers at 127.0.0.1:1" in errors[3]
    assert "is no regular expression" in errors[4]
    assert "none: No such file or directory" in errors[5]
    assert await asyncio.to_thread(lambda: list(tmp_path.iterdir())) == [existing]


async def test_info_list_and_doctor(tmp_path: Path) -> None:
    from support.bags import make_bag

    path = make_bag(
        tmp_path / "a.mcap", [("chatter", n / 10, str(n)) for n in range(11)], flush_every=4
    )
    (code, shown, _), (_, as_json, _), listed, (_, well, _) = await asyncio.gather(
        run("info", str(path)),
        run("info", str(tmp_path), "--json"),
        run("list", str(path)),
        run("doctor", str(path)),
    )
    assert code == 0
    assert "Duration:  1.000 s" in shown
    assert "Messages:  11 in 3 chunks" in shown
    assert "chatter  std_msgs.String  11     10.00 Hz  0.000 s  1.000 s  0        0" in shown
    assert json.loads(as_json)["topics"][0]["rate_hz"] == 10.0
    assert listed == (0, "chatter  std_msgs.String  11\n", "")
    assert well == f"{path}: well, 11 messages in 3 chunks\n"
    path.write_bytes(path.read_bytes()[:-20])
    code, sick, _ = await run("doctor", str(path))
    assert code == 1
    assert "not well, 11 messages" in sick
    assert "a record breaks off" in sick
