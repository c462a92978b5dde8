"""Leases and watchers over real streams, and what the end of a stream does."""

import asyncio
import os
import signal
import subprocess
import sys
from contextlib import asynccontextmanager, suppress

import grpc
import pytest
from support.waiting import Stopwatch

from simple_ros.qos import DEFAULT, SENSOR_DATA
from simple_ros.rpc import master_pb2 as master_pb
from simple_ros.rpc import methods
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros.rpc.convert import qos_to_proto
from simple_ros_master import Master
from simple_ros_master import feed as feed_module
from simple_ros_master import link as link_module
from simple_ros_master.testing import BareClient, BareNode

ODOMETRY = "geometry_msgs.Odometry"


@pytest.fixture
async def client(master):
    async with BareClient(master.address) as client:
        yield client


@pytest.fixture
async def watch(client):
    stream = client.stream(methods.WATCH_GRAPH, master_pb.WatchGraphRequest())
    yield stream
    stream.cancel()


async def read(stream):
    """The next message of a stream, or None at its end."""
    async with asyncio.timeout(30):
        message = await stream.read()
    return None if message is grpc.aio.EOF else message


async def until_gone(watch, name: str) -> None:
    while True:
        event = await read(watch)
        change = event.change
        if change.kind == master_pb.NODE_REMOVED and change.node_info.node_name == name:
            return


def ours(name: str, port: int, instance: str = "1", qos=None) -> ros.NodeInfo:
    info = ros.NodeInfo(ip="127.0.0.1", port=port, node_name=name, instance_id=instance)
    if qos is not None:
        info.endpoint.qos.CopyFrom(qos_to_proto(qos))
    return info


async def open_lease(client: BareClient, info: ros.NodeInfo):
    stream = client.stream(methods.LEASE)
    await stream.write(master_pb.LeaseRequest(open=master_pb.LeaseOpen(node_info=info)))
    return stream


async def leased(client: BareClient, info: ros.NodeInfo):
    stream = await open_lease(client, info)
    granted = (await read(stream)).granted
    assert granted.master_id
    assert granted.master_version
    return stream


async def advertise(client, topic, info, msg_type=ODOMETRY, **extra):
    request = ros.RegisterPublisherRequest(
        topic_name=topic, msg_type=msg_type, node_info=info, **extra
    )
    return await client.call(methods.REGISTER_PUBLISHER, request)


async def subscribe(client, topic, info, msg_type=ODOMETRY, **extra):
    request = ros.SubscribeRequest(topic_name=topic, msg_type=msg_type, node_info=info, **extra)
    return await client.call(methods.SUBSCRIBE, request)


HOLDER = """
import asyncio, sys
from simple_ros.rpc import master_pb2 as m, methods, ros_rpc_pb2 as ros
from simple_ros_master.testing import BareClient

async def main():
    info = ros.NodeInfo(ip="127.0.0.1", port=9, node_name="s", instance_id="1")
    async with BareClient(sys.argv[1]) as client:
        lease = client.stream(methods.LEASE)
        await lease.write(m.LeaseRequest(open=m.LeaseOpen(node_info=info)))
        await lease.read()
        await client.call(methods.SUBSCRIBE, ros.SubscribeRequest(
            topic_name="t", msg_type="geometry_msgs.Odometry", node_info=info))
        await lease.read()

asyncio.run(main())
"""
"""A process that holds a lease for a subscriber named s, until it is ended."""


@asynccontextmanager
async def holder(master: Master):
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-c", HOLDER, master.address, env=environment, stderr=subprocess.DEVNULL
    )
    try:
        yield process
    finally:
        with suppress(ProcessLookupError):
            process.kill()
        await process.wait()


# -- the life of a lease ---------------------------------------------------------------------------


async def test_a_release_removes_the_node_before_the_stream_ends(master, client):
    stream = await leased(client, ours("n", 9))
    assert "n" in master.graph
    await stream.write(master_pb.LeaseRequest(release=master_pb.LeaseRelease()))
    assert await read(stream) is None
    assert "n" not in master.graph
    assert await stream.code() is grpc.StatusCode.OK


@pytest.mark.parametrize("how", ["cancel", "done_writing", "close"])
async def test_the_end_of_a_stream_in_any_way_removes_the_node(master, client, watch, how):
    assert (await read(watch)).HasField("snapshot")
    async with BareNode("p") as publisher, BareClient(master.address) as other:
        await advertise(client, "t", publisher.info())
        await publisher.next_update()
        stream = await leased(other, ours("s", 9))
        await subscribe(other, "t", ours("s", 9))
        assert [t.port for t in (await publisher.next_update()).add_targets] == [9]
        match how:
            case "cancel":
                stream.cancel()
            case "done_writing":
                await stream.done_writing()
            case "close":
                await other.channel.close()
        await until_gone(watch, "s")
        assert [t.port for t in (await publisher.next_update()).remove_targets] == [9]
        assert "s" not in master.graph


async def test_a_killed_process_is_gone_and_its_peers_know(master, client, watch):
    assert (await read(watch)).HasField("snapshot")
    async with BareNode("p") as publisher:
        await advertise(client, "t", publisher.info())
        await publisher.next_update()
        async with holder(master) as process:
            assert [t.port for t in (await publisher.next_update()).add_targets] == [9]
            stopwatch = Stopwatch()
            process.send_signal(signal.SIGKILL)
            assert [t.port for t in (await publisher.next_update()).remove_targets] == [9]
            await until_gone(watch, "s")
            assert stopwatch.seconds < 3


async def test_a_newer_node_takes_the_name(client):
    old = await leased(client, ours("n", 8, "old"))
    new = await leased(client, ours("/n", 9, "new"))
    assert (await read(old)).name_taken.taken_by == ours("n", 9, "new")
    assert await read(old) is None
    assert await old.code() is grpc.StatusCode.OK
    refused = await advertise(client, "t", ours("n", 8, "old"))
    assert not refused.success
    back = await open_lease(client, ours("n", 8, "old"))
    assert (await read(back)).name_taken.taken_by.instance_id == "new"
    assert await read(back) is None
    assert (await advertise(client, "t", ours("n", 9, "new"))).success
    new.cancel()


async def test_a_second_stream_of_the_same_instance_keeps_the_node(master, client):
    first = await leased(client, ours("n", 9))
    second = await leased(client, ours("n", 9))
    assert await read(first) is None
    assert "n" in master.graph
    second.cancel()


@pytest.mark.parametrize(
    "request_",
    [
        master_pb.LeaseRequest(),
        master_pb.LeaseRequest(release=master_pb.LeaseRelease()),
        master_pb.LeaseRequest(open=master_pb.LeaseOpen()),
        master_pb.LeaseRequest(
            open=master_pb.LeaseOpen(node_info=ros.NodeInfo(node_name="n", port=1))
        ),
    ],
)
async def test_a_stream_that_opens_no_lease_is_told_why(client, request_):
    stream = client.stream(methods.LEASE)
    await stream.write(request_)
    with pytest.raises(grpc.aio.AioRpcError) as caught:
        await read(stream)
    assert caught.value.code() is grpc.StatusCode.INVALID_ARGUMENT


async def test_a_leased_node_needs_no_listener_to_live(master, client, watch, monkeypatch):
    monkeypatch.setattr(link_module, "PATIENCE_S", 0.2)
    assert (await read(watch)).HasField("snapshot")
    async with BareNode("witness") as witness:
        stream = await leased(client, ours("n", 9))
        await advertise(client, "t", ours("n", 9))
        # A foreign ghost at the same address is given up; the leased node there is not.
        await advertise(client, "t", ros.NodeInfo(ip="127.0.0.1", port=9, node_name="ghost"))
        await subscribe(client, "t", witness.info())
        await until_gone(watch, "ghost")
        assert "n" in master.graph
        stream.cancel()


# -- what holders are told -------------------------------------------------------------------------


async def test_holders_hear_of_conflicts(client):
    publisher = await leased(client, ours("p", 8))
    subscriber = await leased(client, ours("s", 9))
    await advertise(client, "t", ours("p", 8, qos=SENSOR_DATA), strict=True)
    await subscribe(client, "t", ours("s", 9, qos=DEFAULT), strict=True)
    for stream in (publisher, subscriber):
        conflict = (await read(stream)).qos_conflict
        assert (conflict.publisher, conflict.subscriber) == ("p", "s")
    stranger = ros.NodeInfo(ip="127.0.0.1", port=0, node_name="stranger")
    assert (await subscribe(client, "t", stranger, "a.A")).success
    for stream in (publisher, subscriber):
        conflict = (await read(stream)).type_conflict
        assert (conflict.node_name, conflict.msg_type) == ("stranger", "a.A")
        assert list(conflict.existing_nodes) == ["p", "s"]
    refused = await subscribe(client, "/t", ours("p", 8), "b.B", strict=True)
    assert refused.type_conflict.existing_type == ODOMETRY
    publisher.cancel()
    subscriber.cancel()


async def test_both_ways_of_spelling_meet(client):
    async with BareNode("p") as publisher, BareNode("s") as subscriber:
        lease = await leased(client, publisher.info(instance_id="1"))
        await subscribe(client, "/t", subscriber.info())
        response = await advertise(client, "t", publisher.info(instance_id="1"))
        update = await publisher.next_update()
        assert update.topic == "t"
        assert list(update.add_targets) == list(response.subscribers)
        assert update.add_targets[0].endpoint.topic == "/t"
        lease.cancel()


# -- watching --------------------------------------------------------------------------------------


async def test_a_watcher_sees_the_graph_and_then_each_change(client, watch):
    lonely = ros.NodeInfo(ip="127.0.0.1", port=0, node_name="n")
    await advertise(client, "t", lonely)
    first = await read(watch)
    assert [node.node_info for node in first.snapshot.nodes] in ([], [lonely])
    await subscribe(client, "u", lonely)
    kinds = []
    sequence = first.sequence
    while not kinds or kinds[-1] != master_pb.SUBSCRIBER_ADDED:
        event = await read(watch)
        assert event.sequence == sequence + 1
        sequence = event.sequence
        kinds.append(event.change.kind)
    assert event.change.node_info == lonely
    assert event.change.topic == ros.TopicInfo(topic_name="u", msg_type=ODOMETRY)


async def test_a_watcher_that_reads_nothing_gets_a_snapshot_later(client, monkeypatch):
    monkeypatch.setattr(feed_module, "MAX_WAITING", 3)
    slow = client.stream(methods.WATCH_GRAPH, master_pb.WatchGraphRequest())
    assert (await read(slow)).HasField("snapshot")
    long_name = "n" * 100_000
    for number in range(40):
        info = ros.NodeInfo(ip="127.0.0.1", port=0, node_name=f"{long_name}{number}")
        await advertise(client, "t", info)
    events = [await read(slow)]
    while not events[-1].HasField("snapshot"):
        events.append(await read(slow))
    sequences = [event.sequence for event in events]
    assert sequences == sorted(set(sequences))
    assert len(events[-1].snapshot.nodes) == 40
    slow.cancel()


# -- the end of the Master -------------------------------------------------------------------------


async def test_the_end_of_a_master_parts_nobody():
    async with BareNode("p") as publisher:
        async with Master(port=0) as master, BareClient(master.address) as client:
            await leased(client, ours("s", 9))
            await subscribe(client, "t", ours("s", 9))
            await advertise(client, "t", publisher.info())
            await publisher.next_update()
            await master.stop()
        await publisher.until(lambda: not publisher._writers)
        assert publisher.waiting == 0


@pytest.mark.slow
async def test_a_holder_that_no_longer_answers_loses_its_lease(master, watch):
    """A stopped process keeps its connection, as a host that vanished seems to: pings tell."""
    assert (await read(watch)).HasField("snapshot")
    async with holder(master) as process:
        assert (await read(watch)).change.kind == master_pb.NODE_ADDED
        assert (await read(watch)).change.kind == master_pb.SUBSCRIBER_ADDED
        process.send_signal(signal.SIGSTOP)
        stopwatch = Stopwatch()
        await until_gone(watch, "s")
        assert stopwatch.seconds < 7
