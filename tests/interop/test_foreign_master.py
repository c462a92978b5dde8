"""Our nodes with a C++ Master (a stand-in with its behaviours and its ways to die)."""

from __future__ import annotations

import asyncio

import pytest
from support.foreign_master import ForeignMaster
from support.peers import ForeignListener
from support.waiting import LIMIT_S, until

from simple_ros import registration
from simple_ros.aio import NodeHandle
from simple_ros.msg.example import SensorData
from simple_ros.rpc import ros_rpc_pb2 as ros


async def test_forty_registrations_at_once_leave_it_alive() -> None:
    async with ForeignMaster() as master, NodeHandle("busy", master=master.address) as node:
        await asyncio.gather(*(node.advertise(f"topic{i}", SensorData) for i in range(40)))
        assert master.crashed == []
        assert [topic for _, topic in master.calls] == [f"topic{i}" for i in range(40)]
        await until(lambda: len(master.pushes) == 40, "every push ended by the node")


async def test_many_subscriptions_to_one_publisher_leave_it_alive() -> None:
    async with (
        ForeignMaster() as master,
        NodeHandle("source", master=master.address) as source,
        NodeHandle("sink", master=master.address) as sink,
    ):
        for i in range(10):
            await source.advertise(f"topic{i}", SensorData)
        await asyncio.gather(*(sink.subscribe(f"topic{i}", SensorData) for i in range(10)))
        assert master.crashed == []


async def test_messages_flow_between_our_nodes() -> None:
    got: list[int] = []
    async with (
        ForeignMaster() as master,
        NodeHandle("source", master=master.address) as source,
        NodeHandle("sink", master=master.address) as sink,
    ):
        publisher = await source.advertise("/sensor", SensorData)
        await sink.subscribe("sensor", SensorData, lambda message: got.append(message.sensor_id))
        await publisher.wait_for_subscribers(1, timeout=30)
        for i in range(50):
            publisher.publish(SensorData(sensor_id=i))
        await until(lambda: len(got) == 50)
    assert got == list(range(50))
    assert master.crashed == []


async def test_goodbye_is_said_one_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    # However long this process stands still in between: nothing is left out for want of time.
    monkeypatch.setattr(registration, "_GOODBYE_S", LIMIT_S)
    async with ForeignMaster() as master:
        async with (
            NodeHandle("source", master=master.address) as source,
        ):
            async with NodeHandle("sink", master=master.address) as sink:
                for i in range(5):
                    await source.advertise(f"topic{i}", SensorData)
                    await sink.subscribe(f"topic{i}", SensorData)
            await until(lambda: not any(master.subscribers.values()))
        assert not any(master.publishers.values())
        assert master.crashed == []


async def test_registers_again_with_a_restarted_master_and_links_stay() -> None:
    async with ForeignListener() as listener:
        async with ForeignMaster() as master, NodeHandle("node", master=master.address) as node:
            publisher = await node.advertise("sensor", SensorData)
            target = ros.NodeInfo(ip="127.0.0.1", port=listener.port, node_name="cpp")
            await master._subscribe(
                ros.SubscribeRequest(topic_name="sensor", node_info=target), None
            )
            await publisher.wait_for_subscribers(1, timeout=30)
            port = master.port
            await master.__aexit__()
            publisher.publish(SensorData(sensor_id=1))
            await until(lambda: len(listener.on("sensor")) == 1)
            async with ForeignMaster(port) as successor:
                await until(lambda: "node" in successor.publishers["sensor"])
                publisher.publish(SensorData(sensor_id=2))
                await until(lambda: len(listener.on("sensor")) == 2)
                assert len(listener.carriers) == 1, "the same link carried both"


async def test_foreign_type_on_the_topic_is_not_delivered() -> None:
    """That Master pushes subscribers whatever their type; a frame's type is what counts."""
    got: list[object] = []
    async with ForeignMaster() as master, NodeHandle("sink", master=master.address) as sink:
        await sink.subscribe("sensor", SensorData, got.append)
        _, writer = await asyncio.open_connection("127.0.0.1", sink.port)
        for msg_type, payload in [
            ("geometry_msgs.Point", b""),
            ("example.SensorData", b"\x08\x07"),
        ]:
            header = b"\x00\x06sensor" + len(msg_type).to_bytes(2, "big") + msg_type.encode()
            writer.write(header + len(payload).to_bytes(4, "big") + payload)
        await until(lambda: got)
        writer.close()
        assert got == [SensorData(sensor_id=7)]
        assert sink.dropped_messages.counts == {"type_mismatch": 1}


async def test_a_stale_push_about_a_foreign_topic_is_harmless() -> None:
    async with ForeignMaster() as master, NodeHandle("node", master=master.address) as node:
        publisher = await node.advertise("sensor", SensorData)
        other = ros.NodeInfo(ip="127.0.0.1", port=1, node_name="dead")
        await until(lambda: len(master.pushes) == 1, "the end of the push before")
        master._push(
            master.nodes["node"], ros.TopicTargetsUpdate(topic="old_life", add_targets=[other])
        )
        await until(lambda: len(master.pushes) == 2)
        assert publisher.targets == ()
