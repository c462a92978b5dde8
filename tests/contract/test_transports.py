"""One suite over every transport: what users may rely on, whatever carries their messages."""

from __future__ import annotations

import contextlib
import importlib.util
import sys
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from support.waiting import until

from simple_ros import LATCHED, Durability, QosProfile, QueueFull, Reliability
from simple_ros.aio import NodeHandle
from simple_ros.msg.example import ControlCommand, SensorData
from simple_ros.net.transport import TransportChoice
from simple_ros.testing import MemoryNetwork
from simple_ros_engines.link_shaper.transport import ShapedTransport
from simple_ros_master.server import Master

PLUGINS = Path(__file__).parents[2] / "examples" / "udp_transport"


def udp_transport() -> TransportChoice:
    """The example's transport, from its file: it need not be installed."""
    name = "simple_ros_udp"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, PLUGINS / f"{name}.py")
        assert spec is not None
        assert spec.loader is not None
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return (sys.modules[name].UdpTransport(),)


@dataclass(frozen=True)
class Kind:
    name: str
    make: Callable[[], TransportChoice]
    is_reliable: bool = True
    keeps_order: bool = True
    loses: bool = False
    largest: int = 8 * 1024 * 1024


KINDS = [
    Kind("local", lambda: ("local",)),
    Kind("reference", lambda: ("reference",)),
    Kind("tcp", lambda: ("tcp",)),
    Kind("unix", lambda: ("unix",)),
    Kind("shm", lambda: ("shm",)),
    Kind("memory", lambda: (MemoryNetwork(),)),
    Kind("memory-delay", lambda: (MemoryNetwork(delay_s=0.005, jitter_s=0.005, seed=3),)),
    Kind(
        "memory-loss",
        lambda: (MemoryNetwork(loss=0.2, seed=4),),
        is_reliable=False,
        loses=True,
    ),
    Kind(
        "memory-reorder",
        lambda: (MemoryNetwork(reorder=0.3, reorder_s=0.002, seed=5),),
        is_reliable=False,
        keeps_order=False,
    ),
    Kind("shaped", lambda: (ShapedTransport("robot", "127.0.0.1:1"),)),
    Kind("udp", udp_transport, is_reliable=False, largest=60_000),
]
RELIABLE = [kind for kind in KINDS if kind.is_reliable]


def each(kinds: list[Kind]) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("kind", kinds, ids=lambda kind: kind.name)


def offered(kind: Kind, **changes: object) -> QosProfile:
    reliability = Reliability.RELIABLE if kind.is_reliable else Reliability.BEST_EFFORT
    return QosProfile(reliability=reliability).replace(**changes)


@contextlib.asynccontextmanager
async def nodes(kind: Kind, master: Master) -> AsyncIterator[tuple[NodeHandle, NodeHandle]]:
    transports = kind.make()
    async with (
        NodeHandle("source", master=master.address, transports=transports) as source,
        NodeHandle("sink", master=master.address, transports=transports) as sink,
    ):
        yield source, sink


@each(KINDS)
async def test_messages_arrive_whole_and_in_order(kind: Kind, master: Master) -> None:
    got: list[SensorData] = []
    async with nodes(kind, master) as (source, sink):
        await sink.subscribe("sensor", SensorData, got.append, qos=offered(kind))
        publisher = await source.advertise("sensor", SensorData, qos=offered(kind))
        await publisher.wait_for_subscribers(1, timeout=30)
        for number in range(200):
            publisher.publish(SensorData(sensor_id=number, value=number / 2))
            await publisher.flush()
        # What may be lost is published again and again until the end has been seen.
        while not (got and got[-1].sensor_id == 1000):
            publisher.publish(SensorData(sensor_id=1000, value=500))
            before = len(got)
            with contextlib.suppress(AssertionError):
                await until(lambda before=before: len(got) > before, limit=0.2)

        def numbers() -> list[int]:
            return [message.sensor_id for message in got if message.sensor_id < 1000]

        if not kind.loses:
            # Where order is not kept the last one may overtake others.
            await until(lambda: len(numbers()) >= 200, "all of them")
        assert all(message.value == message.sensor_id / 2 for message in got)
        assert len(set(numbers())) == len(numbers())
        if kind.keeps_order:
            assert numbers() == sorted(numbers())
        if not kind.loses:
            assert sorted(numbers()) == list(range(200))
        assert not sink.dropped_messages.counts


@each(KINDS)
async def test_large_messages_arrive_whole(kind: Kind, master: Master) -> None:
    got: list[ControlCommand] = []
    async with nodes(kind, master) as (source, sink):
        await sink.subscribe("big", ControlCommand, got.append, qos=offered(kind))
        publisher = await source.advertise("big", ControlCommand, qos=offered(kind))
        await publisher.wait_for_subscribers(1, timeout=30)
        text = "0123456789" * (kind.largest // 10 - 10)
        while not got:
            publisher.publish(ControlCommand(cmd_id=7, cmd=text))
            with contextlib.suppress(AssertionError):
                await until(lambda: got, limit=5.0 if kind.is_reliable else 0.2)
        assert got[0].cmd == text


@each([kind for kind in KINDS if kind.name == "udp"])
async def test_what_a_transport_cannot_take_is_dropped_and_counted(
    kind: Kind, master: Master, caplog: pytest.LogCaptureFixture
) -> None:
    got: list[ControlCommand] = []
    async with nodes(kind, master) as (source, sink):
        await sink.subscribe("big", ControlCommand, got.append, qos=offered(kind))
        publisher = await source.advertise("big", ControlCommand, qos=offered(kind))
        await publisher.wait_for_subscribers(1, timeout=30)
        publisher.publish(ControlCommand(cmd="x" * 100_000))
        publisher.publish(ControlCommand(cmd="small"))
        await until(lambda: got)
        assert [message.cmd for message in got] == ["small"]
        assert publisher.statistics.dropped == 1
        assert "udp takes at most" in caplog.text


@each(RELIABLE)
async def test_nothing_is_lost_to_a_slow_subscriber_that_blocks(kind: Kind, master: Master) -> None:
    profile = offered(kind, depth=4, overflow="block")
    async with nodes(kind, master) as (source, sink):
        subscriber = await sink.subscribe("sensor", ControlCommand, qos=profile)
        publisher = await source.advertise("sensor", ControlCommand, qos=profile)
        await publisher.wait_for_subscribers(1, timeout=30)
        filler = "x" * 100_000
        with pytest.raises(QueueFull):
            for sent in range(1000):
                publisher.publish(ControlCommand(cmd_id=sent, cmd=filler))
        assert sent > 0
        for number in range(sent):
            assert (await subscriber.receive_within(30)).cmd_id == number
        await publisher.publish_async(ControlCommand(cmd_id=sent))
        assert (await subscriber.receive_within(30)).cmd_id == sent


@each(RELIABLE)
async def test_a_latched_message_reaches_a_late_joiner(kind: Kind, master: Master) -> None:
    got: list[SensorData] = []
    async with nodes(kind, master) as (source, sink):
        publisher = await source.advertise("map", SensorData, qos=LATCHED)
        publisher.publish(SensorData(sensor_id=3))
        profile = QosProfile(durability=Durability.TRANSIENT_LOCAL)
        await sink.subscribe("map", SensorData, got.append, qos=profile)
        await until(lambda: got)
        assert got[0].sensor_id == 3


@each(KINDS)
async def test_both_sides_see_the_other_come_go_and_come_again(kind: Kind, master: Master) -> None:
    async with nodes(kind, master) as (source, sink):
        profile = offered(kind)
        publisher = await source.advertise("sensor", SensorData, qos=profile)
        for _ in range(2):
            got: list[SensorData] = []
            subscriber = await sink.subscribe("sensor", SensorData, got.append, qos=profile)
            await publisher.wait_for_subscribers(1, timeout=30)
            while not got:
                publisher.publish(SensorData())
                with contextlib.suppress(AssertionError):
                    await until(lambda got=got: got, limit=0.2)
            assert subscriber.publisher_count == 1
            await subscriber.close()
            await until(lambda: publisher.subscriber_count == 0)
        subscriber = await sink.subscribe("sensor", SensorData, got.append, qos=profile)
        await publisher.wait_for_subscribers(1, timeout=30)
        publisher.publish(SensorData())
        await source.close()
        await until(lambda: subscriber.publisher_count == 0)


@each([kind for kind in KINDS if not kind.is_reliable])
async def test_reliable_topics_do_not_go_over_what_may_lose(
    kind: Kind, master: Master, caplog: pytest.LogCaptureFixture
) -> None:
    got: list[SensorData] = []
    async with nodes(kind, master) as (source, sink):
        await sink.subscribe("sensor", SensorData, got.append)
        publisher = await source.advertise("sensor", SensorData)
        await until(lambda: "no transport of this node reaches sink" in caplog.text)
        publisher.publish(SensorData())
        assert publisher.subscriber_count == 0
        assert not got
        # Unless there is a second one that may.
        also = await source.advertise("sensor", SensorData, transports=(*kind.make(), "tcp"))
        await also.wait_for_subscribers(1, timeout=30)
        also.publish(SensorData(sensor_id=5))
        await until(lambda: got)
