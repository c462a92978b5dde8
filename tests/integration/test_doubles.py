"""The doubles that are shipped, and a program that is tested with them."""

from __future__ import annotations

import asyncio

import pytest

from simple_ros import MasterUnavailable, QosProfile, Reliability, TypeDefinitionConflict
from simple_ros.aio import NodeHandle
from simple_ros.events import DeadlineMissed
from simple_ros.msg.example import SensorData
from simple_ros.msg.std_msgs import String
from simple_ros.testing import FakeMaster, ManualClock, MemoryNetwork

BEST_EFFORT = QosProfile(reliability=Reliability.BEST_EFFORT)


def pair(master: FakeMaster, network: MemoryNetwork | None = None) -> tuple[NodeHandle, NodeHandle]:
    transports = None if network is None else (network,)
    return (
        NodeHandle("source", master=master, transports=transports),
        NodeHandle("sink", master=master, transports=transports),
    )


def test_timers_ring_in_order_at_their_own_moment() -> None:
    rings: list[tuple[str, float]] = []

    async def scenario(clock: ManualClock) -> None:
        async with NodeHandle("node", master=FakeMaster()) as node:
            node.create_timer(0.3, lambda _: rings.append(("slow", clock.now)))
            node.create_timer(0.2, lambda _: rings.append(("fast", clock.now)))
            await clock.advance(0.7)
            assert clock.now == pytest.approx(0.7)
            with pytest.raises(ValueError, match="backwards"):
                await clock.advance(-1)

    with ManualClock() as clock:
        clock.run(scenario(clock))
    assert [name for name, _ in rings[:2]] == ["fast", "slow"]
    assert sorted(round(time, 6) for _, time in rings) == [0.2, 0.3, 0.4, 0.6, 0.6]


def test_asyncio_timeouts_follow_the_clock_and_a_busy_loop_is_told() -> None:
    async def scenario(clock: ManualClock) -> None:
        task = asyncio.create_task(asyncio.wait_for(asyncio.Event().wait(), 3600))
        await clock.advance(3599)
        assert not task.done()
        await clock.advance(1)
        with pytest.raises(TimeoutError):
            await task

        def again() -> None:
            asyncio.get_running_loop().call_soon(again)

        again()
        with pytest.raises(RuntimeError, match="still busy"):
            await clock.settle()

    with ManualClock() as clock:
        clock.run(scenario(clock))


def test_a_delay_of_the_network_is_exact() -> None:
    arrivals: list[float] = []

    async def scenario(clock: ManualClock) -> None:
        source, sink = pair(FakeMaster(), MemoryNetwork(delay_s=0.25))
        async with source, sink:
            await sink.subscribe("t", SensorData, lambda _: arrivals.append(clock.now))
            publisher = await source.advertise("t", SensorData)
            await clock.settle()
            publisher.publish(SensorData())
            await clock.advance(0.2)
            assert arrivals == []
            await clock.advance(0.1)

    with ManualClock() as clock:
        clock.run(scenario(clock))
    assert arrivals == [0.25]


def lossy_run(seed: int) -> list[int]:
    got: list[int] = []

    async def scenario(clock: ManualClock) -> None:
        network = MemoryNetwork(delay_s=0.01, loss=0.3, reorder=0.2, seed=seed)
        source, sink = pair(FakeMaster(), network)
        async with source, sink:
            await sink.subscribe(
                "t", SensorData, lambda m: got.append(m.sensor_id), qos=BEST_EFFORT
            )
            publisher = await source.advertise("t", SensorData, qos=BEST_EFFORT)
            await clock.settle()
            for number in range(300):
                publisher.publish(SensorData(sensor_id=number))
                await clock.advance(0.005)
            await clock.advance(1)
            counts = network.counts
            assert counts.sent == counts.delivered + counts.lost
            assert counts.reordered > 0

    with ManualClock() as clock:
        clock.run(scenario(clock))
    return got


def test_chance_is_the_same_for_the_same_seed() -> None:
    first = lossy_run(1)
    assert lossy_run(1) == first != lossy_run(2)
    assert 150 < len(first) < 270
    assert first != sorted(first)
    assert len(set(first)) == len(first)


def test_a_network_that_is_down_and_connections_that_break() -> None:
    got: list[int] = []

    async def scenario(clock: ManualClock) -> None:
        network = MemoryNetwork()
        source, sink = pair(FakeMaster(), network)
        async with source, sink:
            await sink.subscribe("t", SensorData, lambda m: got.append(m.sensor_id))
            publisher = await source.advertise("t", SensorData)
            await clock.settle()
            network.is_down = True
            publisher.publish(SensorData(sensor_id=1))
            await clock.advance(5)
            assert got == []
            network.is_down = False
            await clock.settle()
            assert got == [1]
            network.break_connections()
            await clock.settle()
            assert publisher.subscriber_count == 0
            publisher.publish(SensorData(sensor_id=2))
            await clock.advance(1)
            assert got == [1, 2]

    with ManualClock() as clock:
        clock.run(scenario(clock))


def test_a_deadline_missed_by_a_minute_takes_no_minute() -> None:
    missed: list[DeadlineMissed] = []

    async def scenario(clock: ManualClock) -> None:
        async with NodeHandle("node", master=FakeMaster()) as node:
            await node.subscribe(
                "t", SensorData, print, qos=QosProfile(deadline_s=1.0), on_event=missed.append
            )
            await clock.advance(60.5)

    with ManualClock() as clock:
        clock.run(scenario(clock))
    assert len(missed) == 60


def test_nodes_register_again_with_a_master_that_comes_back() -> None:
    got: list[str] = []

    async def scenario(clock: ManualClock) -> None:
        master = FakeMaster()
        source, sink = pair(master)
        async with source, sink:
            await sink.subscribe("t", String, lambda m: got.append(m.data))
            publisher = await source.advertise("/t", String)
            assert master.nodes == ("sink", "source")
            assert master.publishers_of("t") == ("source",)
            with master.outage():
                await clock.advance(3)
                assert master.publishers_of("t") == ()
                publisher.publish(String(data="without"))
                with pytest.raises(MasterUnavailable):
                    await source.client.get_nodes()
            await clock.advance(1)
            assert master.subscribers_of("t") == ("sink",)
            (topic,) = await source.client.get_topics()
            assert (topic.topic_name, topic.msg_type) == ("t", "std_msgs.String")
            info = await source.client.get_topic_info("t")
            assert [node.node_name for node in info.subscribers] == ["sink"]
            publisher.publish(String(data="with"))
            await clock.settle()
        assert master.nodes == ()

    with ManualClock() as clock:
        clock.run(scenario(clock))
    assert got == ["without", "with"]


async def test_the_fake_master_keeps_definitions() -> None:
    master = FakeMaster()
    async with NodeHandle("node", master=master) as node:
        await node.wait_for_master(30)
        await node.client.declare_type(SensorData)
        found = await node.client.message_class("example.SensorData")
        assert found.DESCRIPTOR.full_name == "example.SensorData"
        assert master.calls[0] == "DeclareType"
        from google.protobuf import descriptor_pb2

        from simple_ros.msg.definitions import message_class

        file = descriptor_pb2.FileDescriptorProto(name="other.proto", package="example")
        file.message_type.add(name="SensorData")
        other = message_class(descriptor_pb2.FileDescriptorSet(file=[file]), "example.SensorData")
        with pytest.raises(TypeDefinitionConflict):
            await node.client.declare_type(other)


@pytest.mark.parametrize("wrong", [{"loss": 1.5}, {"reorder": -0.1}, {"delay_s": -1}])
def test_a_network_that_makes_no_sense(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        MemoryNetwork(**wrong)
