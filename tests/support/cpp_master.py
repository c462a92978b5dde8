"""A stand-in for a C++ Master, for tools that only read; nodes come in no order."""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from typing import Any

import grpc

from simple_ros.graph import GraphNode, TopicKey
from simple_ros.rpc import methods
from simple_ros.rpc import ros_rpc_pb2 as ros


@asynccontextmanager
async def cpp_master(nodes: Sequence[GraphNode]) -> AsyncIterator[str]:
    """The address of a Master that lists these nodes for ever, and answers only the calls that read."""
    infos = {
        node.name: ros.NodeInfo(node_name=node.name, ip=node.ip, port=node.port)
        for node in reversed(nodes)
    }

    async def get_nodes(request: ros.GetNodesRequest, _: object) -> ros.GetNodesResponse:
        found = [info for name, info in infos.items() if request.filter in name]
        return ros.GetNodesResponse(success=True, nodes=found)

    async def get_node_info(request: ros.GetNodeInfoRequest, _: object) -> ros.GetNodeInfoResponse:
        (node,) = (node for node in nodes if node.name == request.node_name)
        return ros.GetNodeInfoResponse(
            success=True,
            node_info=infos[node.name],
            publishes=topics(node.publishes),
            subscribes=topics(node.subscribes),
        )

    def topics(keys: tuple[TopicKey, ...]) -> list[ros.TopicInfo]:
        return [ros.TopicInfo(topic_name=key.topic, msg_type=key.msg_type) for key in keys]

    def handler(method: methods.Method[Any, Any], behaviour: Any) -> grpc.RpcMethodHandler:
        return grpc.unary_unary_rpc_method_handler(
            behaviour, method.request.FromString, method.response.SerializeToString
        )

    table = {
        "GetNodes": handler(methods.GET_NODES, get_nodes),
        "GetNodeInfo": handler(methods.GET_NODE_INFO, get_node_info),
    }
    server = grpc.aio.server(options=[("grpc.so_reuseport", 0)])
    server.add_generic_rpc_handlers(
        (grpc.method_handlers_generic_handler(methods.ROS_RPC_SERVICE, table),)
    )
    port = server.add_insecure_port("127.0.0.1:0")
    await server.start()
    try:
        yield f"127.0.0.1:{port}"
    finally:
        await server.stop(0)
