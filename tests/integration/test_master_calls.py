"""The calls of a Master over real sockets."""

import asyncio

import grpc
import pytest

from simple_ros.errors import AddressInUse, MasterUnavailable
from simple_ros.graph import TopicKey
from simple_ros.net.master_client import MasterClient
from simple_ros.rpc import master_pb2 as master_pb
from simple_ros.rpc import methods
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros_master import Master
from simple_ros_master import server as server_module
from simple_ros_master.testing import BareClient, BareNode

ODOMETRY = "geometry_msgs.Odometry"


@pytest.fixture
async def client(master):
    async with BareClient(master.address) as client:
        yield client


async def test_registration_and_queries_as_cpp_tools_make_them(master, client):
    async with BareNode("quad_simulator") as simulator, BareNode("quad_visualizer") as visualizer:
        for method, request, node in (
            (methods.REGISTER_PUBLISHER, ros.RegisterPublisherRequest, simulator),
            (methods.SUBSCRIBE, ros.SubscribeRequest, visualizer),
        ):
            asked = request(topic_name="quad_odometry", msg_type=ODOMETRY, node_info=node.info())
            response = await client.call(method, asked)
            assert response.success
        nodes = await client.call(methods.GET_NODES, ros.GetNodesRequest(filter="quad"))
        assert list(nodes.nodes) == [simulator.info(), visualizer.info()]
        topics = await client.call(methods.GET_TOPICS, ros.GetTopicsRequest())
        topic = ros.TopicInfo(topic_name="quad_odometry", msg_type=ODOMETRY)
        assert list(topics.topics) == [topic]
        node = await client.call(
            methods.GET_NODE_INFO, ros.GetNodeInfoRequest(node_name="quad_visualizer")
        )
        assert (node.node_info, list(node.subscribes)) == (visualizer.info(), [topic])
        found = await client.call(
            methods.GET_TOPIC_INFO, ros.GetTopicInfoRequest(topic_name="quad_odometry")
        )
        assert [peer.node_name for peer in found.publishers] == ["quad_simulator"]
        assert [peer.node_name for peer in found.subscribers] == ["quad_visualizer"]
        assert master.graph.publishers_of("quad_odometry") == ("quad_simulator",)


async def test_an_unknown_topic_is_not_found(client):
    with pytest.raises(grpc.aio.AioRpcError) as caught:
        await client.call(methods.GET_TOPIC_INFO, ros.GetTopicInfoRequest(topic_name="x"))
    assert caught.value.code() is grpc.StatusCode.NOT_FOUND
    assert caught.value.details() == "Topic not found"


async def test_an_unknown_call_is_unimplemented(client):
    call = client.channel.unary_unary("/simple_ros.RosRpcService/Nonsense")
    with pytest.raises(grpc.aio.AioRpcError) as caught:
        await call(b"")
    assert caught.value.code() is grpc.StatusCode.UNIMPLEMENTED


@pytest.mark.parametrize(
    "info",
    [
        None,
        ros.NodeInfo(),
        ros.NodeInfo(ip="\0", port=-1, node_name="\n"),
        ros.NodeInfo(ip="256.1.1.1", port=2**31 - 1, node_name="x" * 100_000),
        ros.NodeInfo(ip="127.0.0.1", port=1, node_name="n", instance_id="\x7f"),
    ],
)
async def test_garbage_is_answered_like_anything_else(client, info):
    for topic, msg_type in (("", ""), ("/" * 70_000, "T" * 70_000)):
        fields = {"topic_name": topic, "msg_type": msg_type, "node_info": info}
        for method in (
            methods.REGISTER_PUBLISHER,
            methods.SUBSCRIBE,
            methods.UNSUBSCRIBE,
            methods.UNREGISTER_PUBLISHER,
        ):
            assert (await client.call(method, method.request(**fields))).success
    nodes = await client.call(methods.GET_NODES, ros.GetNodesRequest())
    assert nodes.success


async def test_bytes_that_are_no_message_end_only_their_call(client):
    call = client.channel.unary_unary(methods.SUBSCRIBE.path)
    with pytest.raises(grpc.aio.AioRpcError):
        await call(b"\xff\xff\xff")
    assert (await client.call(methods.GET_NODES, ros.GetNodesRequest())).success


async def test_answers_beyond_the_usual_message_limit_arrive(master):
    options = [("grpc.max_receive_message_length", -1)]
    for number in range(6):
        # Straight into the graph: what counts is the size of the answer.
        master.graph.add_publisher("n", TopicKey(f"{number}" * 1_000_000, "T"))
    async with grpc.aio.insecure_channel(master.address, options=options) as channel:
        call = channel.unary_unary(
            methods.GET_TOPICS.path,
            response_deserializer=ros.GetTopicsResponse.FromString,
        )
        assert len((await call(b"")).topics) == 6


@pytest.mark.parametrize(
    ("text_format", "start"),
    [
        (master_pb.GRAPH_FORMAT_READABLE, "==== Message Graph ====\nNodes: 1, Edges: 1\n"),
        (master_pb.GRAPH_FORMAT_DOT, "digraph RosGraph {\n"),
        (master_pb.GRAPH_FORMAT_JSON, '{\n  "edges": ['),
        (99, "==== Message Graph ===="),
    ],
)
async def test_the_graph_is_exported_as_text(master, client, text_format, start):
    master.graph.add_publisher("n", TopicKey("t", "a.A"))
    master.graph.add_subscriber("n", TopicKey("t", "a.A"))
    request = master_pb.ExportGraphRequest()
    request.format = text_format
    assert (await client.call(methods.EXPORT_GRAPH, request)).text.startswith(start)


async def test_a_second_master_on_the_port_says_so(master):
    with pytest.raises(AddressInUse, match="in use by another program") as caught:
        await Master(port=master.port).start()
    assert caught.value.address == master.address
    async with BareClient(master.address) as client:
        assert (await client.call(methods.GET_NODES, ros.GetNodesRequest())).success


async def test_an_address_of_another_host_is_an_error():
    with pytest.raises(OSError, match=r"cannot listen on 192\.0\.2\.1:0"):
        await Master(host="192.0.2.1", port=0).start()


@pytest.mark.parametrize("host", ["0.0.0.0", "localhost"])
async def test_other_addresses_to_listen_on(host):
    async with Master(host=host, port=0) as master:
        assert master.address == f"{host}:{master.port}"
        async with BareClient(f"127.0.0.1:{master.port}") as client:
            assert (await client.call(methods.GET_NODES, ros.GetNodesRequest())).success


async def test_ports_that_cpp_tools_need_are_not_taken_by_chance(monkeypatch):
    offered: list[int] = []

    class FirstOne:
        def __contains__(self, port: int) -> bool:
            offered.append(port)
            return len(offered) == 1

    monkeypatch.setattr(server_module, "RESERVED_PORTS", FirstOne())
    async with Master(port=0) as master:
        assert master.port == offered[1] != offered[0]
        async with await asyncio.start_server(lambda _r, _w: None, "127.0.0.1", offered[0]):
            pass


async def test_a_master_stops_twice_and_starts_once():
    master = Master(port=0)
    with pytest.raises(RuntimeError, match="not started"):
        master.graph.snapshot()
    await master.start()
    with pytest.raises(RuntimeError, match="started already"):
        await master.start()
    await master.stop()
    await master.stop()
    assert len(master.graph) == 0


async def test_a_malformed_request_is_answered_and_floods_no_log(
    master: Master, caplog: pytest.LogCaptureFixture
) -> None:
    async with grpc.aio.insecure_channel(master.address) as channel:
        for path in ("/simple_ros.RosRpcService/Subscribe", "/simple_ros.MasterService/GetType"):
            with pytest.raises(grpc.aio.AioRpcError) as caught:
                await channel.unary_unary(path)(b"\xff\xff\xff")
            assert caught.value.code() is grpc.StatusCode.INVALID_ARGUMENT
        lease = channel.stream_stream("/simple_ros.MasterService/Lease")()
        await lease.write(b"\xff\xff\xff")
        assert await lease.code() is grpc.StatusCode.INVALID_ARGUMENT
    assert "Traceback" not in caplog.text


async def test_a_watcher_whose_client_is_closed_is_told_so_and_a_cancelled_one_is_cancelled(master):
    async def watch(client: MasterClient) -> None:
        async for _ in client.watch_graph():
            begun.set()

    for ends_by_closing in (True, False):
        begun = asyncio.Event()
        client = MasterClient(master.address)
        watching = asyncio.create_task(watch(client))
        await asyncio.wait_for(begun.wait(), 30)
        if ends_by_closing:
            await client.close()
            with pytest.raises(MasterUnavailable, match="closed"):
                await asyncio.wait_for(watching, 30)
        else:
            watching.cancel()
            with pytest.raises(asyncio.CancelledError):
                await watching
            await client.close()
