"""Transports, codecs, engines and demos of other packages."""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from support.processes import python
from support.waiting import until

from simple_ros import ConfigError, QosProfile, Reliability, codecs, plugins
from simple_ros.aio import NodeHandle
from simple_ros.codecs import Codec, codec_of, register_codec
from simple_ros.engine import engine_named
from simple_ros.msg.example import SensorData
from simple_ros.net.transport import TCP, chosen_transports
from simple_ros_master.server import Master

UDP = Path(__file__).parents[2] / "examples" / "udp_transport"
BEST_EFFORT = QosProfile(reliability=Reliability.BEST_EFFORT)


def install(where: Path, entry_points: dict[str, dict[str, str]], **modules: str) -> None:
    """What pip leaves behind, as far as finding plug-ins goes."""
    metadata = where / "things-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: things\nVersion: 1.0\n")
    lines = []
    for group, entries in entry_points.items():
        lines += [f"[{group}]", *(f"{name} = {value}" for name, value in entries.items())]
    (metadata / "entry_points.txt").write_text("\n".join(lines) + "\n")
    for name, text in modules.items():
        (where / f"{name}.py").write_text(text)


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A directory on the import path; what is imported from it is forgotten again."""
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(codecs, "_installed", None)
    before = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - before:
        if str(getattr(sys.modules[name], "__file__", "")).startswith(str(tmp_path)):
            del sys.modules[name]


def install_udp(path: Path) -> None:
    project = tomllib.loads((UDP / "pyproject.toml").read_text())["project"]
    install(path, project["entry-points"], simple_ros_udp=(UDP / "simple_ros_udp.py").read_text())


# -- transports ------------------------------------------------------------------------------------


async def test_the_transport_of_the_example_is_found_by_name(
    path: Path, master: Master, monkeypatch: pytest.MonkeyPatch
) -> None:
    install_udp(path)
    monkeypatch.setenv("SIMPLE_ROS_TRANSPORTS", "udp, tcp")
    got: list[SensorData] = []
    async with (
        NodeHandle("source", master=master.address) as source,
        NodeHandle("sink", master=master.address) as sink,
    ):
        await sink.subscribe("sensor", SensorData, got.append, qos=BEST_EFFORT)
        await sink.subscribe("sure", SensorData, got.append)
        publisher = await source.advertise("sensor", SensorData, qos=BEST_EFFORT)
        sure = await source.advertise("sure", SensorData)
        (info,) = [node for node in await source.client.get_nodes() if node.node_name == "sink"]
        assert [a for a in info.addresses if a.startswith("udp://127.0.0.1:")]
        await publisher.wait_for_subscribers(1, timeout=30)
        await sure.wait_for_subscribers(1, timeout=30)
        (link,) = publisher._links.all
        (sure_link,) = sure._links.all
        assert link._way.transport.scheme == "udp"
        assert sure_link._way.transport is TCP
        publisher.publish(SensorData())
        sure.publish(SensorData())
        await until(lambda: len(got) == 2)


async def test_a_node_that_does_not_know_the_transport_gets_messages_by_tcp(
    path: Path, master: Master
) -> None:
    install_udp(path)
    async with (
        NodeHandle("source", master=master.address, transports=("udp", "tcp")) as source,
        NodeHandle("sink", master=master.address, transports=("tcp",)) as sink,
    ):
        subscriber = await sink.subscribe("sensor", SensorData, qos=BEST_EFFORT)
        publisher = await source.advertise("sensor", SensorData, qos=BEST_EFFORT)
        await publisher.wait_for_subscribers(1, timeout=30)
        publisher.publish(SensorData(sensor_id=4))
        assert (await subscriber.receive_within(30)).sensor_id == 4


async def test_a_udp_peer_that_is_killed_is_noticed_and_found_again(
    path: Path, master: Master
) -> None:
    install_udp(path)
    text = """
        from simple_ros import aio, QosProfile, Reliability
        from simple_ros.msg.example import SensorData

        async def main():
            async with aio.NodeHandle("sink", transports=("udp",)) as node:
                qos = QosProfile(reliability=Reliability.BEST_EFFORT)
                async for message in await node.subscribe("sensor", SensorData, qos=qos):
                    print(message.sensor_id, flush=True)
        aio.run(main())
    """
    import textwrap

    script = path / "sink.py"
    script.write_text(textwrap.dedent(text))
    where = {"SIMPLE_ROS_MASTER": master.address, "PYTHONPATH": str(path)}
    async with NodeHandle("source", master=master.address, transports=("udp",)) as source:
        publisher = await source.advertise("sensor", SensorData, qos=BEST_EFFORT)
        source.create_timer(0.02, lambda _: publisher.publish(SensorData(sensor_id=8)))
        for _ in range(2):
            async with python(str(script), **where) as sink:
                assert await sink.line() == "8"
                await sink.kill()
            await until(lambda: publisher.subscriber_count == 0)


def test_a_transport_nobody_installed() -> None:
    with pytest.raises(plugins.UnknownPlugin, match="no transport 'lora' is installed") as caught:
        NodeHandle("node", transports=("lora",))
    assert isinstance(caught.value, ConfigError)


def test_a_broken_transport_and_one_that_is_none(path: Path) -> None:
    entries = {"broken": "no_such_module:thing", "odd": "odd_module:thing"}
    install(path, {plugins.TRANSPORTS: entries}, odd_module="thing = 5\n")
    with pytest.raises(plugins.BrokenPlugin, match="no_such_module"):
        chosen_transports(("broken",))
    with pytest.raises(ConfigError, match=r"transport 'odd' is 5, no .*Transport"):
        chosen_transports(("odd",))
    with pytest.raises(ConfigError, match="at least one transport"):
        chosen_transports(())


# -- codecs ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Reading:
    sensor: int
    value: float


class ReadingCodec(Codec):
    """Writes a Reading as an example.SensorData."""

    def handles(self, message_class: type) -> bool:
        return message_class is Reading

    def type_name(self, message_class: type) -> str:
        return "example.SensorData"

    def definition(self, message_class: type) -> Any:
        return SensorData

    def encode(self, message: Reading) -> bytes:
        if message.sensor < 0:
            raise ValueError("sensors are numbered from 0")
        return SensorData(sensor_id=message.sensor, value=message.value).SerializeToString()

    def decode(self, data: memoryview, message_class: type) -> Reading:
        message = SensorData.FromString(data)
        if message.sensor_id == 13:
            raise ValueError("no sensor has that number")
        return Reading(message.sensor_id, message.value)


@pytest.fixture
def reading_codec(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(codecs, "_registered", [])
    register_codec(ReadingCodec())


@pytest.mark.usefixtures("reading_codec")
async def test_other_classes_travel_as_protobuf_types(master: Master) -> None:
    async with (
        NodeHandle("source", master=master.address) as source,
        NodeHandle("sink", master=master.address) as sink,
    ):
        readings: list[Reading] = []
        again: list[Reading] = []
        messages: list[SensorData] = []
        raw: list[bytes] = []
        await sink.subscribe("r", Reading, readings.append)
        await sink.subscribe("r", Reading, again.append)
        await sink.subscribe("r", SensorData, messages.append)
        await sink.subscribe("r", "example.SensorData", raw.append, raw=True)
        publisher = await source.advertise("r", Reading)
        plain = await source.advertise("r", SensorData)
        assert publisher.msg_type == "example.SensorData"
        await publisher.wait_for_subscribers(1, timeout=30)
        publisher.publish(Reading(3, 0.5))
        await until(lambda: raw)
        assert readings == [Reading(3, 0.5)]
        assert again[0] is readings[0]
        assert messages == [SensorData(sensor_id=3, value=0.5)]
        plain.publish(SensorData(sensor_id=13))
        plain.publish(SensorData(sensor_id=4))
        await until(lambda: len(messages) == 3)
        assert readings == [Reading(3, 0.5), Reading(4, 0.0)]
        assert sink.dropped_messages.counts["unparsable"] == 1
        with pytest.raises(ValueError, match="numbered from 0"):
            publisher.publish(Reading(-1, 0))
        with pytest.raises(TypeError, match=r"topic 'r' carries example\.SensorData, not str"):
            publisher.publish("text")  # type: ignore[arg-type]


def test_a_class_that_nothing_handles() -> None:
    with pytest.raises(TypeError, match="is not a protobuf message class, and no codec handles it"):
        codec_of(dict)


def test_codecs_of_packages_are_found_and_broken_ones_left_out(
    path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    text = """
from simple_ros.codecs import Codec
class Text(Codec):
    def handles(self, message_class): return message_class is str
    def type_name(self, message_class): return "text"
    def encode(self, message): return message.encode()
    def decode(self, data, message_class): return bytes(data).decode()
"""
    entries = {"text": "text_codec:Text", "broken": "no_such_module:thing", "odd": "math:pi"}
    install(path, {plugins.CODECS: entries}, text_codec=text)
    codec = codec_of(str)
    assert codec.encode("ä") == "ä".encode()
    assert codec.decoder(str) == codec.decoder(str)
    assert "codec plug-in 'broken' is left out" in caplog.text
    assert "codec plug-in 'odd' is left out" in caplog.text


# -- engines and demos -----------------------------------------------------------------------------

ENGINE = """
from simple_ros.engine import Engine
from simple_ros.msg.std_msgs import String

class Greeter(Engine):
    node_name = "greeter"
    summary = "Says hello."

    async def run(self, node):
        publisher = await node.advertise("hello", String)
        node.create_timer(0.02, lambda event: publisher.publish(String(data="hello")))
        await node.spin()
"""


async def test_an_engine_is_listed_and_runs_as_a_node(path: Path, master: Master) -> None:
    install(
        path, {plugins.ENGINES: {"greeter": "greeter:Greeter", "no": "math:pow"}}, greeter=ENGINE
    )
    assert engine_named("greeter").summary == "Says hello."
    with pytest.raises(plugins.UnknownPlugin, match="no engine 'other'"):
        engine_named("other")
    where = {"SIMPLE_ROS_MASTER": master.address, "PYTHONPATH": str(path)}
    command = ("-m", "simple_ros.cli.main", "engine", "run", "greeter")
    async with (
        NodeHandle("listener", master=master.address) as node,
        python(*command, **where) as process,
    ):
        subscriber = await node.subscribe("hello", "std_msgs.String")
        assert (await subscriber.receive_within(30)).data == "hello"
        assert [n.node_name for n in await node.client.get_nodes("greeter")] == ["greeter"]
        process.signal(2)
        assert await process.wait() == 0


async def test_a_demo_of_a_package_runs_by_name(path: Path) -> None:
    text = "def command(times: int = 1) -> None:\n    print('dance ' * times)\n"
    install(path, {plugins.DEMOS: {"dance": "dance:command"}}, dance=text)
    async with python(
        "-m", "simple_ros.cli.main", "demo", "dance", "--times", "2", PYTHONPATH=str(path)
    ) as process:
        assert (await process.line()).strip() == "dance dance"
        assert await process.wait() == 0
