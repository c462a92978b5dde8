"""Messages between nodes, over a real Master and real sockets."""

from __future__ import annotations

import asyncio
import logging

import pytest
from support.peers import ForeignListener
from support.waiting import until

from simple_ros.aio import MasterClient, NodeHandle
from simple_ros.errors import HandleClosed, TopicTypeMismatch, UnknownMessageType
from simple_ros.msg.example import ControlCommand, SensorData
from simple_ros.msg.geometry_msgs import Odometry
from simple_ros.qos import DEFAULT
from simple_ros.rpc import methods
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros_master import Master

LOSSLESS = DEFAULT.replace(overflow="block")


async def foreign(master: Master, kind: str, topic: str, port: int, name: str = "cpp") -> None:
    """Register as a C++ node does, with nothing but the shared fields."""
    fields = {
        "topic_name": topic,
        "msg_type": "example.SensorData",
        "node_info": ros.NodeInfo(ip="127.0.0.1", port=port, node_name=name),
    }
    async with MasterClient(master.address) as client:
        if kind == "subscriber":
            answer = await client.call(methods.SUBSCRIBE, ros.SubscribeRequest(**fields))
            assert answer.success
        else:
            request = ros.RegisterPublisherRequest(**fields)
            assert (await client.call(methods.REGISTER_PUBLISHER, request)).success


async def test_first_messages_are_not_lost(master: Master) -> None:
    got: list[int] = []
    async with (
        NodeHandle("source", master=master.address) as source,
        NodeHandle("sink", master=master.address, ip="127.0.0.1") as sink,
        ForeignListener() as cpp,
    ):
        await sink.subscribe("sensor", SensorData, lambda message: got.append(message.sensor_id))
        await foreign(master, "subscriber", "sensor", cpp.port)
        publisher = await source.advertise("sensor", SensorData)
        for i in range(100):
            publisher.publish(SensorData(sensor_id=i))
        await until(lambda: len(got) == 100 and len(cpp.frames) == 100)
    assert got == list(range(100))
    assert [SensorData.FromString(data).sensor_id for data in cpp.on("sensor")] == got


@pytest.mark.parametrize("ours", ["sensor", "/sensor"])
@pytest.mark.parametrize("theirs", ["sensor", "/sensor"])
async def test_one_topic_whatever_the_slash(master: Master, ours: str, theirs: str) -> None:
    """A frame to a foreign peer carries that peer's spelling, and ours takes both."""
    got: list[int] = []
    async with NodeHandle("/node", master=master.address) as node, ForeignListener() as cpp:
        publisher = await node.advertise(ours, SensorData)
        subscriber = await node.subscribe(
            ours, SensorData, lambda message: got.append(message.sensor_id)
        )
        assert publisher.topic == subscriber.topic == "sensor"
        await foreign(master, "subscriber", theirs, cpp.port)
        await publisher.wait_for_subscribers(2, timeout=30)
        publisher.publish(SensorData(sensor_id=1))
        publisher.publish(SensorData(sensor_id=2))
        await until(lambda: len(cpp.frames) == 2)
        assert {(topic, kind) for topic, kind, _ in cpp.frames} == {(theirs, "example.SensorData")}

        _, writer = await asyncio.open_connection("127.0.0.1", node.port)
        raw = theirs.encode()
        writer.write(
            len(raw).to_bytes(2, "big") + raw + b"\0\x12example.SensorData\0\0\0\2\x08\x09"
        )
        await until(lambda: got == [1, 2, 9])
        writer.close()
        assert [info.topic_name for info in await node.client.get_topics()] == ["sensor"]
        assert "node" in [info.node_name for info in await node.client.get_nodes()]


async def test_all_forms_of_callback_get_everything_in_order(master: Master) -> None:
    plain: list[int] = []
    awaited: list[int] = []
    iterated: list[int] = []
    raw: list[bytes] = []

    class Robot:
        def on_sensor(self, message: SensorData) -> None:
            plain.append(message.sensor_id)

    async def on_sensor(message: SensorData) -> None:
        await asyncio.sleep(0)
        awaited.append(message.sensor_id)

    async with (
        NodeHandle("source", master=master.address) as source,
        NodeHandle("sink", master=master.address) as sink,
    ):
        await sink.subscribe("sensor", SensorData, Robot().on_sensor)
        await sink.subscribe("sensor", SensorData, on_sensor, qos=LOSSLESS)
        await sink.subscribe("sensor", "example.SensorData", raw.append, raw=True)
        named = await sink.subscribe("sensor", "example.SensorData", qos=LOSSLESS)

        async def iterate() -> None:
            async for message in named:
                iterated.append(message.sensor_id)

        task = asyncio.create_task(iterate())
        publisher = await source.advertise("sensor", SensorData, qos=LOSSLESS)
        for i in range(1000):
            await publisher.publish_async(SensorData(sensor_id=i))
        everything = list(range(1000))
        await until(lambda: len(iterated) == len(awaited) == len(plain) == 1000)
        assert plain == awaited == iterated == everything
        assert [SensorData.FromString(data).sensor_id for data in raw] == everything
        await named.close()
        await asyncio.wait_for(task, 30)


async def test_a_burst_larger_than_the_queue_reaches_a_consumer_that_keeps_up(
    master: Master,
) -> None:
    got: list[int] = []

    async def on_sensor(message: SensorData) -> None:
        got.append(message.sensor_id)

    async with NodeHandle("sink", master=master.address) as sink:
        subscriber = await sink.subscribe("sensor", SensorData, on_sensor, qos=10)
        _, writer = await asyncio.open_connection("127.0.0.1", sink.port)
        header = b"\0\6sensor\0\x12example.SensorData"
        for i in range(5000):
            payload = SensorData(sensor_id=i).SerializeToString()
            writer.write(header + len(payload).to_bytes(4, "big") + payload)
        await until(lambda: subscriber.statistics.received == 5000)
        await until(lambda: len(got) + subscriber.statistics.dropped == 5000)
        assert subscriber.statistics.dropped == 0
        assert got == list(range(5000))
        writer.close()


async def test_a_stuck_consumer_drops_its_oldest_and_hurts_nobody(master: Master) -> None:
    plain: list[int] = []
    stuck = asyncio.Event()
    seen: list[int] = []

    async def slow(message: SensorData) -> None:
        seen.append(message.sensor_id)
        await stuck.wait()

    async with (
        NodeHandle("source", master=master.address) as source,
        NodeHandle("sink", master=master.address) as sink,
    ):
        subscriber = await sink.subscribe("sensor", SensorData, slow, qos=10)
        await sink.subscribe("sensor", SensorData, lambda message: plain.append(message.sensor_id))
        publisher = await source.advertise("sensor", SensorData)
        for i in range(1000):
            publisher.publish(SensorData(sensor_id=i))
            await asyncio.sleep(0)
        await until(lambda: len(plain) == 1000)
        assert subscriber.statistics.waiting == 10
        assert subscriber.statistics.dropped == 989
        stuck.set()
        await until(lambda: len(seen) == 11)
        assert seen == [0, *range(990, 1000)]


async def test_nothing_after_close_and_siblings_go_on(master: Master) -> None:
    closed: list[int] = []
    open_: list[int] = []
    async with NodeHandle("node", master=master.address) as node:
        first = await node.subscribe("sensor", SensorData, lambda m: closed.append(m.sensor_id))
        await node.subscribe("sensor", SensorData, lambda m: open_.append(m.sensor_id))
        publisher = await node.advertise("sensor", SensorData)
        publisher.publish(SensorData(sensor_id=1))
        await until(lambda: closed and open_)
        await first.close()
        await first.close()
        publisher.publish(SensorData(sensor_id=2))
        await until(lambda: open_ == [1, 2])
        assert closed == [1]


async def test_a_dropped_handle_is_no_unsubscription(master: Master) -> None:
    import gc

    got: list[int] = []
    async with NodeHandle("node", master=master.address) as node:
        await node.subscribe("sensor", SensorData, lambda m: got.append(m.sensor_id))
        publisher = await node.advertise("sensor", SensorData)
        gc.collect()
        publisher.publish(SensorData(sensor_id=1))
        await until(lambda: got == [1])


async def test_leaving_is_told_to_publishers(master: Master) -> None:
    async with NodeHandle("source", master=master.address) as source:
        publisher = await source.advertise("sensor", SensorData)
        async with NodeHandle("sink", master=master.address) as sink:
            subscriber = await sink.subscribe("sensor", SensorData, lambda m: None)
            await publisher.wait_for_subscribers(1, timeout=30)
            await subscriber.close()
            await until(lambda: not publisher.targets)
            await sink.subscribe("sensor", SensorData, lambda m: None)
            await publisher.wait_for_subscribers(1, timeout=30)
        await until(lambda: not publisher.targets)
        names = [info.node_name for info in await source.client.get_nodes()]
        assert names == ["source"]


async def test_local_subscribers_need_no_network_and_get_their_own_copy(master: Master) -> None:
    got: list[SensorData] = []
    async with NodeHandle("node", master=master.address) as node:
        await node.subscribe("sensor", SensorData, got.append)
        publisher = await node.advertise("sensor", SensorData)
        message = SensorData(sensor_id=1)
        publisher.publish(message)
        message.sensor_id = 2
        publisher.publish(message)
        await until(lambda: len(got) == 2)
        assert [item.sensor_id for item in got] == [1, 2]
        assert all(b"example" not in link._decoder._header for link in node._server.links), (
            "no data link was dialled"
        )


async def test_wrong_type_names_both_types_and_nodes(master: Master) -> None:
    async with (
        NodeHandle("first", master=master.address) as first,
        NodeHandle("second", master=master.address) as second,
    ):
        publisher = await first.advertise("sensor", SensorData)
        with pytest.raises(TopicTypeMismatch) as caught:
            await second.subscribe("/sensor", ControlCommand, lambda m: None)
        error = caught.value
        assert (error.topic, error.node_name) == ("sensor", "second")
        assert (error.msg_type, error.existing_type) == (
            "example.ControlCommand",
            "example.SensorData",
        )
        assert error.existing_nodes == ("first",)
        with pytest.raises(TopicTypeMismatch):
            await second.advertise("sensor", Odometry)
        info = await first.client.get_node_info("second")
        assert info is not None
        assert not info.publishes
        assert not info.subscribes
        await publisher.close()
        await second.advertise("sensor", Odometry)


async def test_publish_refuses_another_type(master: Master) -> None:
    async with NodeHandle("node", master=master.address) as node:
        publisher = await node.advertise("sensor", SensorData)
        with pytest.raises(TypeError, match=r"example\.SensorData, not example\.ControlCommand"):
            publisher.publish(ControlCommand())  # type: ignore[arg-type]
        with pytest.raises(TypeError, match="str"):
            publisher.publish("hello")  # type: ignore[arg-type]
        with pytest.raises(UnknownMessageType, match="SensorDat"):
            await node.subscribe("x", "example.SensorDat")


async def test_closed_handles_say_so(master: Master) -> None:
    node = NodeHandle("node", master=master.address)
    await node.start()
    publisher = await node.advertise("sensor", SensorData)
    await publisher.close()
    with pytest.raises(HandleClosed, match="publisher of 'sensor'"):
        publisher.publish(SensorData())
    await node.close()
    await node.close()
    with pytest.raises(HandleClosed, match="node"):
        await node.advertise("sensor", SensorData)


async def test_last_message_before_the_end_arrives(master: Master) -> None:
    got: list[int] = []
    async with (
        ForeignListener() as cpp,
        NodeHandle("sink", master=master.address) as sink,
    ):
        await sink.subscribe("sensor", SensorData, lambda m: got.append(m.sensor_id))
        await foreign(master, "subscriber", "sensor", cpp.port)
        async with NodeHandle("source", master=master.address) as source:
            publisher = await source.advertise("sensor", SensorData)
            publisher.publish(SensorData(sensor_id=7))
        await until(lambda: got == [7] and len(cpp.frames) == 1)


async def test_exception_in_a_callback_is_logged_counted_and_survived(
    master: Master, caplog: pytest.LogCaptureFixture
) -> None:
    got: list[int] = []

    def on_sensor(message: SensorData) -> None:
        if message.sensor_id == 1:
            raise ZeroDivisionError("boom")
        got.append(message.sensor_id)

    async def on_sensor_async(message: SensorData) -> None:
        on_sensor(message)

    async with NodeHandle("node", master=master.address) as node:
        plain = await node.subscribe("sensor", SensorData, on_sensor)
        awaited = await node.subscribe("sensor", SensorData, on_sensor_async)
        publisher = await node.advertise("sensor", SensorData)
        for i in range(3):
            publisher.publish(SensorData(sensor_id=i))
        await until(lambda: len(got) == 4)
        assert plain.statistics.errors == awaited.statistics.errors == 1
    assert "ZeroDivisionError: boom" in caplog.text
    assert "Traceback" in caplog.text
    assert "the subscription to 'sensor'" in caplog.text


async def test_two_publishers_of_one_node_share_a_registration(master: Master) -> None:
    got: list[int] = []
    async with (
        NodeHandle("source", master=master.address) as source,
        NodeHandle("sink", master=master.address) as sink,
    ):
        await sink.subscribe("sensor", SensorData, lambda m: got.append(m.sensor_id))
        first = await source.advertise("sensor", SensorData)
        second = await source.advertise("sensor", SensorData)
        first.publish(SensorData(sensor_id=1))
        second.publish(SensorData(sensor_id=2))
        await until(lambda: sorted(got) == [1, 2])
        await first.close()
        second.publish(SensorData(sensor_id=3))
        await until(lambda: len(got) == 3)


async def test_foreign_nodes_get_their_answers_but_nothing_of_another_type(
    master: Master, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    async with NodeHandle("node", master=master.address) as node, ForeignListener() as cpp:
        publisher = await node.advertise("cmd", ControlCommand)
        await foreign(master, "subscriber", "cmd", cpp.port)
        await until(lambda: "TopicTypeMismatch" in caplog.text)
        assert publisher.targets == ()
        assert "'cpp' uses example.SensorData" in caplog.text


async def test_further_addresses_are_tried_when_the_first_does_not_answer(master: Master) -> None:
    """As for a peer whose IPv4 is behind another interface, or that has IPv6 only."""
    import socket

    async with NodeHandle("source", master=master.address) as node, ForeignListener() as cpp:
        # Bound, so that nobody else gets it, and refusing, since nobody listens.
        closed = socket.socket()
        closed.bind(("127.0.0.1", 0))
        closed_port = closed.getsockname()[1]
        publisher = await node.advertise("sensor", SensorData)
        publisher.publish(SensorData(sensor_id=1))
        target = ros.NodeInfo(
            ip="127.0.0.1",
            port=closed_port,
            instance_id="other",
            addresses=[f"[::1]:{closed_port}", f"127.0.0.1:{cpp.port}"],
        )
        node.endpoints.apply_targets("sensor", [target])
        publisher.publish(SensorData(sensor_id=2))
        await until(lambda: len(cpp.frames) == 1)
        closed.close()


async def test_everything_may_be_done_inside_a_plain_callback(master: Master) -> None:
    """Publish, publish on the same topic, and close the very subscription that is called."""
    got: list[int] = []
    tasks: list[asyncio.Task[None]] = []
    async with (
        NodeHandle("source", master=master.address) as source,
        NodeHandle("sink", master=master.address) as sink,
    ):
        publisher = await source.advertise("sensor", SensorData)

        def on_sensor(message: SensorData) -> None:
            got.append(message.sensor_id)
            if message.sensor_id < 5:
                publisher.publish(SensorData(sensor_id=message.sensor_id + 1))
            else:
                tasks.append(asyncio.create_task(subscriber.close()))

        subscriber = await sink.subscribe("sensor", SensorData, on_sensor)
        await publisher.wait_for_subscribers(1, timeout=30)
        publisher.publish(SensorData(sensor_id=0))
        await until(lambda: tasks and tasks[0].done())
        assert got == [0, 1, 2, 3, 4, 5]
        await until(lambda: not publisher.targets)
