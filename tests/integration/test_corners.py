"""Corners of a node's life where something could be lost, kept for ever, or hang."""

from __future__ import annotations

import asyncio
import signal
import threading

import grpc
import pytest
from support.foreign_master import ForeignMaster
from support.peers import ForeignListener
from support.processes import master_process, program
from support.waiting import Stopwatch, until

from simple_ros.aio import MasterClient, NodeHandle
from simple_ros.errors import HandleClosed
from simple_ros.events import IncompatibleQos, LivelinessChanged, QosEvent
from simple_ros.msg.example import SensorData
from simple_ros.net import addresses
from simple_ros.net.master_client import ForeignMaster as ForeignMasterError
from simple_ros.qos import DEFAULT, LATCHED, SENSOR_DATA, Durability
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros_master import Master


async def test_a_topic_advertised_anew_has_its_subscribers(master: Master) -> None:
    got: list[int] = []
    async with (
        NodeHandle("source", master=master.address) as source,
        NodeHandle("sink", master=master.address) as sink,
    ):
        await sink.subscribe("sensor", SensorData, lambda m: got.append(m.sensor_id))
        publisher = await source.advertise("sensor", SensorData)
        closing = asyncio.create_task(publisher.close())
        publisher = await source.advertise("sensor", SensorData)
        publisher.publish(SensorData(sensor_id=1))
        await until(lambda: got == [1])
        await closing


async def test_raw_and_typed_subscriptions_do_not_mix(master: Master) -> None:
    got: list[object] = []
    async with NodeHandle("node", master=master.address) as node:
        raw = await node.subscribe("sensor", "example.SensorData", got.append, raw=True)
        await raw.close()
        await node.subscribe("sensor", "example.SensorData", got.append, raw=True)
        await node.subscribe("sensor", SensorData, got.append)
        publisher = await node.advertise("sensor", SensorData)
        publisher.publish(SensorData(sensor_id=1))
        await until(lambda: len(got) == 2)
        assert got == [b"\x08\x01", SensorData(sensor_id=1)]


async def test_a_registration_given_up_halfway_leaves_no_ghost() -> None:
    async with master_process() as (process, address):
        async with NodeHandle("node", master=address) as node:
            await node.wait_for_master(30)
            process.signal(signal.SIGSTOP)
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(node.subscribe("sensor", SensorData), 0.1)
            process.signal(signal.SIGCONT)
            await node.advertise("other", SensorData)
            async with MasterClient(address) as client:

                async def registered() -> list[str]:
                    info = await client.get_node_info("node")
                    assert info is not None
                    return [topic.topic_name for topic in info.subscribes]

                while await registered():
                    pass
        assert node.router._routes == {}


async def test_a_server_that_is_no_master_is_named(caplog: pytest.LogCaptureFixture) -> None:
    server = grpc.aio.server()
    port = server.add_insecure_port("127.0.0.1:0")
    await server.start()
    async with NodeHandle("node", master=f"127.0.0.1:{port}") as node:
        with pytest.raises(ForeignMasterError):
            await asyncio.wait_for(node.advertise("sensor", SensorData), 30)
        with pytest.raises(ForeignMasterError):
            await asyncio.wait_for(node.subscribe("sensor", SensorData), 30)
    await server.stop(0)


async def test_strange_registrations_break_no_publisher(master: Master) -> None:
    async with NodeHandle("node", master=master.address) as node, ForeignListener() as cpp:
        publisher = await node.advertise("sensor", SensorData)
        strange = [
            ros.NodeInfo(ip="a" * 200, port=1, node_name="a"),
            ros.NodeInfo(ip="127.0.0.1", port=99_999, node_name="b"),
            ros.NodeInfo(ip="127.0.0.1", port=1, node_name="c", addresses=["nonsense"]),
            ros.NodeInfo(
                ip="127.0.0.1",
                port=2,
                node_name="d",
                endpoint=ros.Endpoint(topic="/" * 1100 + "sensor"),
            ),
            ros.NodeInfo(ip="127.0.0.1", port=cpp.port, node_name="good"),
        ]
        node.endpoints.apply_targets("sensor", strange)
        publisher.publish(SensorData(sensor_id=1))
        await until(lambda: len(cpp.frames) == 1)


async def test_a_cancelled_future_in_a_callback_ends_nothing(master: Master) -> None:
    plain: list[int] = []
    awaited: list[int] = []
    ticks: list[int] = []

    def cancelled(ids: list[int], number: int) -> asyncio.Future[None] | None:
        ids.append(number)
        if number != 1:
            return None
        future = asyncio.get_running_loop().create_future()
        future.cancel()
        return future

    def on_plain(message: SensorData) -> None:
        future = cancelled(plain, message.sensor_id)
        if future is not None:
            future.result()

    async def on_awaited(message: SensorData) -> None:
        future = cancelled(awaited, message.sensor_id)
        if future is not None:
            await future

    async def tick(event: object) -> None:
        future = cancelled(ticks, len(ticks))
        if future is not None:
            await future

    async with (
        NodeHandle("source", master=master.address) as source,
        NodeHandle("sink", master=master.address) as sink,
    ):
        await sink.subscribe("sensor", SensorData, on_plain)
        await sink.subscribe("sensor", SensorData, on_awaited)
        sink.create_timer(0.002, tick)
        publisher = await source.advertise("sensor", SensorData)
        for i in range(4):
            publisher.publish(SensorData(sensor_id=i))
        await until(lambda: plain == awaited == [0, 1, 2, 3])
        await until(lambda: len(ticks) >= 4)


async def test_a_node_may_be_closed_from_its_own_timer(master: Master) -> None:
    node = await NodeHandle("node", master=master.address).start()
    after: list[str] = []

    async def end(event: object) -> None:
        await node.close()
        after.append("still here")

    node.create_timer(0.001, end)
    await asyncio.wait_for(node.spin(), 30)
    await until(lambda: after)


async def test_a_cancelled_close_still_closes(master: Master) -> None:
    node = await NodeHandle("node", master=master.address).start()
    await node.wait_for_master(30)
    with pytest.raises(TimeoutError):
        await asyncio.wait_for(node.close(), 0)
    await node.close()
    await asyncio.wait_for(node.spin(), 30)
    assert node._server is not None
    assert node._server.hosts == ()


async def test_what_waits_for_a_master_ends_with_its_node() -> None:
    node = await NodeHandle("node", master="127.0.0.1:1").start()
    waiting = [
        asyncio.create_task(node.advertise("sensor", SensorData)),
        asyncio.create_task(node.subscribe("sensor", SensorData)),
        asyncio.create_task(node.wait_for_master()),
    ]
    await asyncio.sleep(0)
    await node.close()
    for task in waiting:
        with pytest.raises(HandleClosed):
            await asyncio.wait_for(task, 30)


async def test_attempts_given_up_without_a_master_leave_nothing() -> None:
    async with NodeHandle("node", master="127.0.0.1:1") as node:
        for index in range(20):
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(node.advertise(f"topic{index}", SensorData), 0.001)
        assert node._registrar is not None
        assert node._registrar._waiting == {}
        assert node.endpoints.publishers == ()


async def test_short_lived_topics_leave_nothing(master: Master) -> None:
    async with (
        NodeHandle("source", master=master.address) as source,
        NodeHandle("sink", master=master.address) as sink,
    ):
        for index in range(20):
            got: list[SensorData] = []
            subscriber = await sink.subscribe(f"topic{index}", SensorData, got.append)
            publisher = await source.advertise(f"topic{index}", SensorData)
            publisher.publish(SensorData())
            await until(lambda got=got: got)
            await publisher.close()
            await subscriber.close()
        await until(lambda: not sink.router._by_link)
        assert sink.router._routes == {}
        assert source.endpoints._push_links == {}
        assert source.endpoints._unpushed == set()


async def test_several_subscriptions_of_a_node_request_the_most_demanding_together(
    master: Master,
) -> None:
    events: list[QosEvent] = []
    async with (
        NodeHandle("source", master=master.address) as source,
        NodeHandle("sink", master=master.address) as sink,
    ):
        publisher = await source.advertise("sensor", SensorData, qos=SENSOR_DATA)
        modest = await sink.subscribe("sensor", SensorData, print, qos=SENSOR_DATA)
        await publisher.wait_for_subscribers(1, timeout=30)
        demanding = await sink.subscribe(
            "sensor", SensorData, print, qos=DEFAULT, on_event=events.append
        )
        await until(lambda: IncompatibleQos("sensor", "source", "sink", ("reliability",)) in events)
        await until(lambda: publisher.subscriber_count == 0)
        await demanding.close()
        await publisher.wait_for_subscribers(1, timeout=30)
        assert modest.qos == SENSOR_DATA


async def test_every_late_joiner_gets_the_latched_message(master: Master) -> None:
    got: dict[str, list[int]] = {"volatile": [], "first": [], "second": []}
    async with (
        NodeHandle("source", master=master.address) as source,
        NodeHandle("sink", master=master.address) as sink,
    ):
        publisher = await source.advertise("map", SensorData, qos=LATCHED)
        publisher.publish(SensorData(sensor_id=7))
        for name, qos in [("volatile", DEFAULT), ("first", LATCHED), ("second", LATCHED)]:
            await sink.subscribe(
                "map", SensorData, lambda m, name=name: got[name].append(m.sensor_id), qos=qos
            )
            await until(lambda name=name: got[name][-1:] == [7])
        assert got["first"] == got["second"] == [7]


async def test_a_latched_message_is_worth_nothing_after_its_lifespan(master: Master) -> None:
    got: list[int] = []
    qos = DEFAULT.replace(durability=Durability.TRANSIENT_LOCAL, lifespan_s=0.01)
    async with NodeHandle("node", master=master.address) as node:
        publisher = await node.advertise("map", SensorData, qos=qos)
        publisher.publish(SensorData(sensor_id=1))
        loop = asyncio.get_running_loop()
        late = loop.time() + 0.02
        await until(lambda: loop.time() > late)
        await node.subscribe("map", SensorData, lambda m: got.append(m.sensor_id))
        await publisher.wait_for_subscribers(1, timeout=30)
        while not got:  # one that waits too long here is worth nothing, either
            publisher.publish(SensorData(sensor_id=2))
            await asyncio.sleep(0)
        assert 1 not in got


async def test_a_second_subscription_hears_that_publishers_are_alive(master: Master) -> None:
    events: list[QosEvent] = []
    got: list[SensorData] = []
    async with NodeHandle("node", master=master.address) as node:
        await node.subscribe("sensor", SensorData, got.append)
        publisher = await node.advertise("sensor", SensorData)
        publisher.publish(SensorData())
        await until(lambda: got)
        await node.subscribe("sensor", SensorData, got.append, on_event=events.append)
        assert events == [LivelinessChanged("sensor", True)]


async def test_a_burst_in_one_tick_is_whole_locally_as_over_the_network(master: Master) -> None:
    got: list[int] = []
    async with NodeHandle("node", master=master.address) as node:
        await node.subscribe("sensor", SensorData, lambda m: got.append(m.sensor_id))
        publisher = await node.advertise("sensor", SensorData)
        for i in range(1000):
            publisher.publish(SensorData(sensor_id=i))
        await until(lambda: len(got) == 1000)
        assert got == list(range(1000))
        assert publisher.statistics.dropped == 0


async def test_a_local_peer_that_ends_without_a_master_is_no_subscriber() -> None:
    async with Master(host="127.0.0.1", port=0) as master:
        source = await NodeHandle("source", master=master.address).start()
        sink = await NodeHandle("sink", master=master.address).start()
        await sink.subscribe("sensor", SensorData, print)
        publisher = await source.advertise("sensor", SensorData)
        assert publisher.subscriber_count == 1
    await sink.close()
    assert publisher.subscriber_count == 0
    publisher.publish(SensorData())
    assert publisher.statistics.sent == 0
    await source.close()


async def test_a_node_started_before_the_network_listens_everywhere(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """No route to the Master yet, as on a robot that boots: the address is found later."""
    monkeypatch.setattr(addresses, "own_ipv4", lambda master: "127.0.0.1")
    monkeypatch.setattr(addresses, "_interface_addresses", list)
    async with NodeHandle("node", master="192.0.2.1:50051") as node:
        assert node._server is not None
        assert "0.0.0.0" in node._server.hosts


async def test_a_large_node_leaves_nothing_with_a_foreign_master() -> None:
    async with ForeignMaster() as master:
        async with NodeHandle("node", master=master.address) as node:
            for index in range(40):
                await node.advertise(f"topic{index}", SensorData)
        assert not any(master.publishers.values())
        assert master.crashed == []


async def test_publishing_from_another_thread_is_always_refused(master: Master) -> None:
    async with NodeHandle("node", master=master.address) as node:
        await node.subscribe("sensor", SensorData, lambda m: None)
        publisher = await node.advertise("sensor", SensorData)
        refused = 0

        def publish() -> None:
            nonlocal refused
            for _ in range(20):
                try:
                    publisher.publish(SensorData())
                except RuntimeError:
                    refused += 1

        thread = threading.Thread(target=publish)
        thread.start()
        await until(lambda: not thread.is_alive())
        assert refused == 20
        assert publisher.statistics.published == 0


STUCK = """
    import contextlib, sys
    from simple_ros import aio
    from simple_ros.msg.example import ControlCommand

    async def main():
        async with aio.NodeHandle("talker") as node, contextlib.AsyncExitStack() as stack:
            publishers = [
                await stack.enter_async_context(await node.advertise(f"big{i}", ControlCommand))
                for i in range(8)
            ]
            for publisher in publishers:
                await publisher.wait_for_subscribers(1)
            message = ControlCommand(cmd="x" * 1_000_000)
            def tick(event):
                for publisher in publishers:
                    publisher.publish(message)
                if all(p.statistics.waiting for p in publishers):
                    print("stuck", flush=True)
            node.create_timer(0.001, tick)
            await node.spin()

    aio.run(main())
"""


async def test_the_end_is_quick_with_publishers_that_are_stuck(master: Master) -> None:
    async def never_read(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writers.append(writer)
        await ended.wait()

    writers: list[asyncio.StreamWriter] = []
    ended = asyncio.Event()
    server = await asyncio.start_server(never_read, "127.0.0.1", 0, limit=1024)
    port = server.sockets[0].getsockname()[1]
    async with MasterClient(master.address) as client:
        for index in range(8):
            info = ros.NodeInfo(ip="127.0.0.1", port=port, node_name="stuck")
            request = ros.SubscribeRequest(
                topic_name=f"big{index}", msg_type="example.ControlCommand", node_info=info
            )
            from simple_ros.rpc import methods

            await client.call(methods.SUBSCRIBE, request)
    async with program(STUCK, master=master.address) as talker:
        assert await talker.line() == "stuck"
        watch = Stopwatch()
        talker.signal(signal.SIGINT)
        assert await talker.wait() == 0
        # Up to 0.5 s for all of them; one after the other it would be 4 s.
        assert watch.seconds < 2.0
        assert await talker.errors() == ""
    ended.set()
    server.close()
    for writer in writers:
        writer.transport.abort()
    await server.wait_closed()
