"""Quality of service, seen from both ends of real links."""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from support.peers import ForeignListener
from support.waiting import until

from simple_ros.aio import NodeHandle
from simple_ros.errors import QueueFull
from simple_ros.events import DeadlineMissed, IncompatibleQos, LivelinessChanged, QosEvent
from simple_ros.msg.example import ControlCommand, SensorData
from simple_ros.qos import DEFAULT, LATCHED, SENSOR_DATA, Liveliness
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros_master import Master

MEGABYTE = ControlCommand(cmd="x" * 1_000_000)


@contextmanager
def stalled_target(publisher_node: NodeHandle, topic: str) -> Iterator[None]:
    """A subscriber whose link is accepted by its kernel and never read."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        target = ros.NodeInfo(ip="127.0.0.1", port=listener.getsockname()[1], node_name="stalled")
        publisher_node.endpoints.apply_targets(topic, [target])
        yield


async def test_latched_message_reaches_late_joiners(master: Master) -> None:
    got: list[int] = []
    async with (
        NodeHandle("source", master=master.address) as source,
        NodeHandle("sink", master=master.address) as sink,
        ForeignListener() as cpp,
    ):
        publisher = await source.advertise("map", SensorData, qos=LATCHED)
        for i in range(3):
            publisher.publish(SensorData(sensor_id=i))
        await sink.subscribe("map", SensorData, lambda m: got.append(m.sensor_id), qos=LATCHED)
        await source.subscribe("map", SensorData, lambda m: got.append(m.sensor_id + 100))
        source.endpoints.apply_targets("map", [ros.NodeInfo(ip="127.0.0.1", port=cpp.port)])
        await until(lambda: len(got) == 2 and len(cpp.frames) == 1)
        assert sorted(got) == [2, 102]
        assert SensorData.FromString(cpp.frames[0][2]).sensor_id == 2


async def test_offer_below_request_is_named_on_both_sides_and_nothing_flows(
    master: Master, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    events: list[QosEvent] = []
    got: list[SensorData] = []
    async with (
        NodeHandle("source", master=master.address) as source,
        NodeHandle("sink", master=master.address) as sink,
    ):
        publisher = await source.advertise(
            "sensor", SensorData, qos=SENSOR_DATA, on_event=events.append
        )
        await sink.subscribe("sensor", SensorData, got.append, on_event=events.append)
        await until(lambda: len(events) == 2)
        expected = IncompatibleQos("sensor", "source", "sink", ("reliability",))
        assert events == [expected, expected]
        publisher.publish(SensorData())
        assert publisher.statistics.sent == 0
        fitting = await sink.subscribe("other", SensorData, got.append, qos=SENSOR_DATA)
        other = await source.advertise("other", SensorData)
        other.publish(SensorData())
        await until(lambda: fitting.statistics.received == 1)
    assert caplog.text.count("IncompatibleQos") == 2


async def test_a_stalled_subscriber_never_delays_the_others(master: Master) -> None:
    got = 0

    def count(_: ControlCommand) -> None:
        nonlocal got
        got += 1

    async with (
        NodeHandle("source", master=master.address) as source,
        NodeHandle("sink", master=master.address) as sink,
    ):
        await sink.subscribe("big", ControlCommand, count)
        publisher = await source.advertise(
            "big", ControlCommand, qos=DEFAULT.replace(depth=5, max_bytes=3_000_000)
        )
        with stalled_target(source, "big"):
            await publisher.wait_for_subscribers(2, timeout=30)
            for i in range(40):
                publisher.publish(MEGABYTE)
                await until(lambda i=i: got == i + 1)
        statistics = publisher.statistics
        assert 0 < statistics.waiting <= 3, "bounded in messages and in bytes"
        assert statistics.dropped > 0
        assert statistics.sent + statistics.dropped + statistics.waiting == 80


async def test_block_waits_for_room_and_loses_nothing(master: Master) -> None:
    got: list[int] = []
    release = asyncio.Event()

    async def slow(message: SensorData) -> None:
        await release.wait()
        got.append(message.sensor_id)

    async with (
        NodeHandle("source", master=master.address) as source,
        NodeHandle("sink", master=master.address) as sink,
    ):
        qos = DEFAULT.replace(depth=10, overflow="block")
        await sink.subscribe("sensor", SensorData, slow, qos=qos)
        publisher = await source.advertise("sensor", SensorData, qos=qos)
        sent = 0
        with pytest.raises(QueueFull, match="publish_async"):
            while True:
                publisher.publish(SensorData(sensor_id=sent))
                sent += 1
                if sent % 5 == 0:
                    await asyncio.sleep(0)
        waiting = asyncio.create_task(publisher.publish_async(SensorData(sensor_id=sent)))
        release.set()
        await asyncio.wait_for(waiting, 30)
        await until(lambda: len(got) == sent + 1)
        assert got == list(range(sent + 1))
        assert publisher.statistics.dropped == 0


async def test_best_effort_forgets_what_a_broken_link_held(master: Master) -> None:
    async with NodeHandle("source", master=master.address) as source:
        publisher = await source.advertise("big", ControlCommand, qos=SENSOR_DATA)
        with stalled_target(source, "big"):
            await publisher.wait_for_subscribers(1, timeout=30)
            while not publisher.statistics.waiting:
                publisher.publish(MEGABYTE)
        await until(lambda: publisher.statistics.waiting == 0)
        assert publisher.statistics.dropped > 0


async def test_lifespan_expires_waiting_messages(master: Master) -> None:
    got: list[int] = []
    stuck = asyncio.Event()

    async def slow(message: SensorData) -> None:
        got.append(message.sensor_id)
        await stuck.wait()

    async with NodeHandle("node", master=master.address) as node:
        # Longer than this process may stand still before the first one is taken.
        qos = DEFAULT.replace(lifespan_s=0.7)
        subscriber = await node.subscribe("sensor", SensorData, slow, qos=qos)
        publisher = await node.advertise("sensor", SensorData)
        publisher.publish(SensorData(sensor_id=0))
        await until(lambda: got == [0])
        for i in (1, 2):
            publisher.publish(SensorData(sensor_id=i))
        await until(lambda: subscriber.statistics.waiting == 2)
        aged = asyncio.get_running_loop().time() + 0.75
        await until(lambda: asyncio.get_running_loop().time() > aged)
        stuck.set()
        await until(lambda: subscriber.statistics.expired == 2)
        assert got == [0]


async def test_deadlines_are_watched_on_both_sides(master: Master) -> None:
    events: list[QosEvent] = []
    theirs: list[QosEvent] = []
    async with NodeHandle("node", master=master.address) as node:
        begun = asyncio.get_running_loop().time()
        qos = DEFAULT.replace(deadline_s=0.02)
        await node.subscribe("sensor", SensorData, lambda m: None, qos=qos, on_event=events.append)
        publisher = await node.advertise("sensor", SensorData, qos=qos, on_event=theirs.append)
        for side in (events, theirs):
            await until(lambda side=side: len(side) >= 3)  # type: ignore[misc]
            missed = [event for event in side if isinstance(event, DeadlineMissed)]
            assert {(event.topic, event.deadline_s) for event in missed} == {("sensor", 0.02)}
            # Whole periods: more than one at once if this process stood still.
            totals = [event.total for event in missed]
            passed = asyncio.get_running_loop().time() - begun
            assert totals == sorted(set(totals))
            assert 1 <= totals[0] < totals[-1] <= passed / 0.02
        publisher.publish(SensorData())
        await until(lambda: any(isinstance(e, LivelinessChanged) and e.alive for e in events))


async def test_liveliness_follows_the_publishers_connection(master: Master) -> None:
    events: list[QosEvent] = []
    async with NodeHandle("sink", master=master.address) as sink:
        await sink.subscribe("sensor", SensorData, lambda m: None, on_event=events.append)
        async with NodeHandle("source", master=master.address) as source:
            publisher = await source.advertise("sensor", SensorData)
            publisher.publish(SensorData())
            await until(lambda: events == [LivelinessChanged("sensor", True)])
        await until(lambda: events[1:] == [LivelinessChanged("sensor", False)])


async def test_manual_liveliness_follows_messages(master: Master) -> None:
    events: list[QosEvent] = []
    qos = DEFAULT.replace(liveliness=Liveliness.MANUAL_BY_TOPIC, liveliness_lease_s=0.03)
    async with NodeHandle("node", master=master.address) as node:
        await node.subscribe("sensor", SensorData, lambda m: None, qos=qos, on_event=events.append)
        publisher = await node.advertise("sensor", SensorData, qos=qos)
        publisher.publish(SensorData())
        await until(lambda: len(events) == 2)
        assert events == [LivelinessChanged("sensor", True), LivelinessChanged("sensor", False)]


async def test_block_counts_bytes_too(master: Master) -> None:
    got = 0

    async def slow(message: ControlCommand) -> None:
        nonlocal got
        await asyncio.sleep(0)
        got += 1

    async with (
        NodeHandle("source", master=master.address) as source,
        NodeHandle("sink", master=master.address) as sink,
    ):
        qos = DEFAULT.replace(overflow="block", max_bytes=1_000_000)
        subscriber = await sink.subscribe("big", ControlCommand, slow, qos=qos)
        publisher = await source.advertise("big", ControlCommand, qos=qos)
        for _ in range(50):
            await publisher.publish_async(ControlCommand(cmd="x" * 100_000))
        await until(lambda: got == 50)
        assert subscriber.statistics.dropped == publisher.statistics.dropped == 0


async def test_flush_after_a_best_effort_link_broke(master: Master) -> None:
    async with NodeHandle("source", master=master.address) as source:
        publisher = await source.advertise("big", ControlCommand, qos=SENSOR_DATA)
        with stalled_target(source, "big"):
            await publisher.wait_for_subscribers(1, timeout=30)
            while not publisher.statistics.waiting:
                publisher.publish(MEGABYTE)
            flushing = asyncio.create_task(publisher.flush(5))
            await asyncio.sleep(0)
        (link,) = publisher._links.all
        link._transport.abort()  # type: ignore[union-attr]
        await flushing
