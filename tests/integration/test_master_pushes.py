"""Pushes to nodes that are quick, slow, late, rude or dead."""

import asyncio
import socket

import pytest
from support.waiting import Stopwatch

from simple_ros.rpc import methods
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros_master import link as link_module
from simple_ros_master import pushes
from simple_ros_master.testing import BareClient, BareNode

ODOMETRY = "geometry_msgs.Odometry"


class Registrar(BareClient):
    async def advertise(self, topic, info):
        request = ros.RegisterPublisherRequest(topic_name=topic, msg_type=ODOMETRY, node_info=info)
        return await self.call(methods.REGISTER_PUBLISHER, request)

    async def subscribe(self, topic, info):
        request = ros.SubscribeRequest(topic_name=topic, msg_type=ODOMETRY, node_info=info)
        return await self.call(methods.SUBSCRIBE, request)

    async def unsubscribe(self, topic, info):
        request = ros.UnsubscribeRequest(topic_name=topic, msg_type=ODOMETRY, node_info=info)
        return await self.call(methods.UNSUBSCRIBE, request)


@pytest.fixture
async def client(master):
    async with Registrar(master.address) as client:
        yield client


def ports(targets) -> list[int]:
    return [target.port for target in targets]


def free_port() -> int:
    """A port on which nobody listens, for a moment at least."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


async def test_the_sample_push_arrives_byte_for_byte(client):
    async with BareNode("quad_simulator") as publisher:
        await client.advertise("quad_odometry", publisher.info())
        assert not (await publisher.next_update()).add_targets
        publisher.raw.clear()
        visualizer = ros.NodeInfo(ip="127.0.0.1", port=60001, node_name="quad_visualizer")
        await client.subscribe("quad_odometry", visualizer)
        await publisher.next_update()
        assert bytes(publisher.raw) == (
            b"\x00\x0dquad_odometry\x00\x12TopicTargetsUpdate\x00\x00\x00\x31"
            b"\x0a\x0dquad_odometry\x12\x20\x0a\x09127.0.0.1\x10\xe1\xd4\x03\x1a\x0fquad_visualizer"
        )
        assert len(publisher.raw) == 88


async def test_a_push_without_a_topic_travels_under_a_stand_in(client):
    async with BareNode("n") as node:
        await client.advertise("", node.info())
        await node.next_update()
        assert node.raw.startswith(b"\x00\x15__master_topic_update\x00\x12TopicTargetsUpdate")


async def test_forty_registrations_at_once_give_forty_pushes_in_order(client):
    async with BareNode("n") as node:
        topics = [f"t{number:02}" for number in range(40)]
        await asyncio.gather(*(client.advertise(topic, node.info()) for topic in topics))
        registered = [topic.topic_name for topic in (await _topics(client))]
        pushed = [(await node.next_update()).topic for _ in topics]
        assert sorted(pushed) == registered == topics
        assert node.accepted == 1


async def _topics(client):
    return (await client.call(methods.GET_TOPICS, ros.GetTopicsRequest())).topics


async def test_back_to_back_registrations_are_pushed_in_the_order_they_were_made(client):
    async with BareNode("n") as node:
        for number in range(40):
            await client.advertise(f"t{number}", node.info())
        assert [(await node.next_update()).topic for _ in range(40)] == [
            f"t{number}" for number in range(40)
        ]


async def test_subscribers_come_and_go_on_one_kept_connection(client):
    async with BareNode("p") as publisher, BareNode("s") as subscriber:
        await client.subscribe("t", subscriber.info())
        await client.advertise("t", publisher.info())
        assert ports((await publisher.next_update()).add_targets) == [subscriber.port]
        await client.unsubscribe("t", subscriber.info())
        assert ports((await publisher.next_update()).remove_targets) == [subscriber.port]
        await client.subscribe("t", subscriber.info())
        assert ports((await publisher.next_update()).add_targets) == [subscriber.port]
        assert publisher.accepted == 1
        assert subscriber.waiting == 0


async def test_a_node_that_registers_before_it_listens_gets_every_push(client):
    node = BareNode("late")
    node.port = free_port()
    for number in range(10):
        await client.advertise(f"t{number}", node.info())
    async with node:
        assert [(await node.next_update()).topic for _ in range(10)] == [
            f"t{number}" for number in range(10)
        ]


async def test_after_a_broken_connection_everything_is_said_anew(client):
    async with BareNode("p") as publisher, BareNode("s") as subscriber:
        for topic in ("t", "u"):
            await client.advertise(topic, publisher.info())
            await publisher.next_update()
        await client.subscribe("t", subscriber.info())
        await publisher.next_update()
        await publisher.close_connections()
        updates = [await publisher.next_update() for _ in range(2)]
        assert [(u.topic, u.snapshot, ports(u.add_targets)) for u in updates] == [
            ("t", True, [subscriber.port]),
            ("u", True, []),
        ]
        await client.subscribe("u", subscriber.info())
        last = await publisher.next_update()
        assert (last.topic, last.snapshot) == ("u", False)
        assert publisher.accepted == 2


async def test_a_node_that_hangs_up_after_each_push_lives_and_hears_everything(client):
    async with BareNode("rude", hang_up=True) as rude, BareNode("s") as subscriber:
        await client.advertise("t", rude.info())
        await rude.next_update()
        await client.subscribe("t", subscriber.info())
        while subscriber.port not in ports((await rude.next_update()).add_targets):
            pass
        nodes = (await client.call(methods.GET_NODES, ros.GetNodesRequest())).nodes
        assert sorted(node.node_name for node in nodes) == ["rude", "s"]
        assert rude.accepted < 20


async def test_a_node_that_takes_nothing_delays_nobody_and_is_told_everything_later(
    client, master, monkeypatch
):
    monkeypatch.setattr(link_module, "MAX_FRAMES", 50)
    # Nobody listens where the subscribers are said to be: they stay until all is told.
    monkeypatch.setattr(link_module, "PATIENCE_S", 60.0)
    with socket.socket() as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        listener.setblocking(False)
        stuck = ros.NodeInfo(ip="127.0.0.1", port=listener.getsockname()[1], node_name="stuck")
        async with BareNode("quick") as quick:
            await client.advertise("t", stuck)
            await client.advertise("t", quick.info())
            await quick.next_update()
            connection, _ = await asyncio.get_running_loop().sock_accept(listener)
            with connection:
                big = ros.NodeInfo(ip="127.0.0.1", port=9, node_name="s" * 200_000)
                for number in range(100):
                    big.port = number + 1
                    big.node_name = f"{number}" + "s" * 200_000
                    await client.subscribe("t", big)
                    assert ports((await quick.next_update()).add_targets) == [number + 1]
                assert await _last_update_of(connection) >= {*range(1, 101)}


async def _last_update_of(connection: socket.socket) -> set[int]:
    """The targets of the first snapshot on a connection that nobody read so far."""
    reader, writer = await asyncio.open_connection(sock=connection)
    try:
        async with asyncio.timeout(30):
            while True:
                await reader.readexactly(2 + 1 + 2 + len("TopicTargetsUpdate"))
                size = int.from_bytes(await reader.readexactly(4), "big")
                update = ros.TopicTargetsUpdate.FromString(await reader.readexactly(size))
                if update.snapshot:
                    return set(ports(update.add_targets))
    finally:
        writer.close()
        await writer.wait_closed()


# -- liveness of nodes without a lease -------------------------------------------------------------


async def test_a_killed_node_is_removed_and_its_publishers_are_told(client, master):
    async with BareNode("p") as publisher, BareNode("s") as subscriber:
        await client.advertise("t", publisher.info())
        await client.subscribe("t", subscriber.info())
        await publisher.next_update()
        assert ports((await publisher.next_update()).add_targets) == [subscriber.port]
        await subscriber.connected()
        await subscriber.stop_listening()
        watch = Stopwatch()
        gone = await publisher.next_update()
        assert watch.seconds < 3
        assert ports(gone.remove_targets) == [subscriber.port]
        assert "s" not in master.graph


async def test_a_node_that_never_listens_is_removed_after_its_patience(client, master, monkeypatch):
    monkeypatch.setattr(link_module, "PATIENCE_S", 0.5)
    async with BareNode("p") as publisher:
        ghost = ros.NodeInfo(ip="127.0.0.1", port=free_port(), node_name="ghost")
        await client.advertise("t", publisher.info())
        await publisher.next_update()
        started = asyncio.get_running_loop().time()
        await client.subscribe("t", ghost)
        assert ports((await publisher.next_update()).add_targets) == [ghost.port]
        watch = Stopwatch()
        assert ports((await publisher.next_update()).remove_targets) == [ghost.port]
        assert watch.seconds < 2
        assert asyncio.get_running_loop().time() - started > 0.45
        assert "ghost" not in master.graph


async def test_a_node_that_comes_back_at_once_stays(client, master):
    async with BareNode("n") as node:
        await client.advertise("t", node.info())
        await node.next_update()
        await node.stop_listening()
        await node.listen()
        assert (await node.next_update()).snapshot
        assert "n" in master.graph


async def test_a_node_that_unregistered_is_let_go(client, master):
    async with BareNode("n") as node:
        await client.subscribe("t", node.info())
        await node.connected()
        await client.unsubscribe("t", node.info())
        await node.until(lambda: not node._writers)
        assert len(master.graph) == 0


def test_nobody_is_taken_for_a_node_by_connecting_to_oneself():
    # Dialling a free port of the ephemeral range can end like this, now and then.
    with socket.socket() as selfish:
        selfish.bind(("127.0.0.1", 0))
        selfish.connect(selfish.getsockname())
        with pytest.raises(ConnectionRefusedError):
            pushes._refuse_oneself(selfish)
