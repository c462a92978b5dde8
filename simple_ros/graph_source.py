"""The graph as a value, from any Master."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import aclosing

from simple_ros.errors import MasterUnavailable
from simple_ros.graph import GraphNode, GraphSnapshot, TopicKey, edges_between
from simple_ros.net.master_client import ForeignMaster, MasterClient
from simple_ros.rpc import ros_rpc_pb2 as ros

__all__ = ["fetch_graph"]


async def fetch_graph(client: MasterClient) -> GraphSnapshot:
    """The whole graph as it is now.

    Raises:
        MasterUnavailable: Nobody answers.
    """
    try:
        async with aclosing(client.watch_graph()) as events:  # type: ignore[type-var]
            async for event in events:
                if isinstance(event, GraphSnapshot):
                    return event
    except ForeignMaster:
        return await _collected(client)
    raise MasterUnavailable(client.address, "it told no graph")


async def _collected(client: MasterClient) -> GraphSnapshot:
    """From the calls of a C++ Master, one after the other: it cannot take more."""
    nodes = []
    for info in sorted(await client.get_nodes(), key=lambda info: info.node_name):
        details = await client.get_node_info(info.node_name)
        if details is not None:
            publishes, subscribes = _keys(details.publishes), _keys(details.subscribes)
            nodes.append(GraphNode(info.node_name, info.ip, info.port, publishes, subscribes))
    return GraphSnapshot(tuple(nodes), edges_between(tuple(nodes)))


def _keys(topics: Iterable[ros.TopicInfo]) -> tuple[TopicKey, ...]:
    return tuple(sorted(TopicKey(topic.topic_name, topic.msg_type) for topic in topics))
