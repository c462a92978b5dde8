"""Answers to the four registry queries, in the words of C++ simple_ros.

Pure functions of a directory. Names in answers are canonical; filters are substrings, and a leading
slash in a filter or a name means the same as none. Lists are ordered by name.
"""

from __future__ import annotations

from simple_ros.graph import TopicKey
from simple_ros.names import canonical
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros_master.directory import Directory
from simple_ros_master.graph import Role

__all__ = ["get_node_info", "get_nodes", "get_topic_info", "get_topics"]


def get_nodes(directory: Directory, request: ros.GetNodesRequest) -> ros.GetNodesResponse:
    """Nodes whose name contains the filter."""
    wanted = canonical(request.filter)
    peers = sorted((name, peer) for name, peer in directory.peers.items() if wanted in name)
    return ros.GetNodesResponse(
        success=True,
        message="Get nodes list success",
        nodes=[peer.info() for _, peer in peers],
    )


def get_node_info(directory: Directory, request: ros.GetNodeInfoRequest) -> ros.GetNodeInfoResponse:
    """One node with its topics; an unknown one is an answer without success."""
    name = canonical(request.node_name)
    peer, node = directory.peers.get(name), directory.graph.node(name)
    if peer is None or node is None:
        return ros.GetNodeInfoResponse(message=f"Node not found: {request.node_name}")
    return ros.GetNodeInfoResponse(
        success=True,
        message="Get node info success",
        node_info=peer.info(),
        publishes=[_topic_info(key) for key in node.publishes],
        subscribes=[_topic_info(key) for key in node.subscribes],
    )


def get_topics(directory: Directory, request: ros.GetTopicsRequest) -> ros.GetTopicsResponse:
    """Topics whose name contains the filter, each with the first of its types."""
    wanted = canonical(request.filter)
    return ros.GetTopicsResponse(
        success=True,
        message="Get topics success",
        topics=[_topic_info(key) for key in directory.graph.topics() if wanted in key.topic],
    )


def get_topic_info(
    directory: Directory, request: ros.GetTopicInfoRequest
) -> ros.GetTopicInfoResponse | None:
    """Both ends of a topic under the first of its types; None for an unknown topic."""
    topic = canonical(request.topic_name)
    types = directory.graph.types_of(topic)
    if not types:
        return None
    key = TopicKey(topic, types[0])
    publishers, subscribers = (
        [
            directory.peers[name].info_with(role, key)
            for name in sorted(directory.graph.at(role, key))
        ]
        for role in Role
    )
    return ros.GetTopicInfoResponse(
        success=True,
        message="Get topic info success",
        topic_name=key.topic,
        msg_type=key.msg_type,
        publishers=publishers,
        subscribers=subscribers,
    )


def _topic_info(key: TopicKey) -> ros.TopicInfo:
    return ros.TopicInfo(topic_name=key.topic, msg_type=key.msg_type)
