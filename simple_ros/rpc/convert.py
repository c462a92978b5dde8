"""Control-plane messages to and from the project's own values."""

from __future__ import annotations

from collections.abc import Iterable

from simple_ros import qos
from simple_ros.graph import (
    ChangeKind,
    GraphChange,
    GraphNode,
    GraphService,
    GraphSnapshot,
    TopicKey,
    edges_between,
)
from simple_ros.rpc import master_pb2 as master
from simple_ros.rpc import ros_rpc_pb2 as ros

__all__ = [
    "change_from_proto",
    "change_to_proto",
    "qos_from_proto",
    "qos_to_proto",
    "snapshot_from_proto",
    "snapshot_to_proto",
]

_NS = 1_000_000_000

_RELIABILITY = {
    qos.Reliability.BEST_EFFORT: ros.RELIABILITY_BEST_EFFORT,
    qos.Reliability.RELIABLE: ros.RELIABILITY_RELIABLE,
}
_DURABILITY = {
    qos.Durability.VOLATILE: ros.DURABILITY_VOLATILE,
    qos.Durability.TRANSIENT_LOCAL: ros.DURABILITY_TRANSIENT_LOCAL,
}
_LIVELINESS = {
    qos.Liveliness.AUTOMATIC: ros.LIVELINESS_AUTOMATIC,
    qos.Liveliness.MANUAL_BY_TOPIC: ros.LIVELINESS_MANUAL_BY_TOPIC,
}
_RELIABILITY_BACK = {number: value for value, number in _RELIABILITY.items()}
_DURABILITY_BACK = {number: value for value, number in _DURABILITY.items()}
_LIVELINESS_BACK = {number: value for value, number in _LIVELINESS.items()}


def qos_to_proto(profile: qos.QosProfile) -> ros.QosPolicies:
    """The part of a profile that peers need to know."""
    return ros.QosPolicies(
        reliability=_RELIABILITY[profile.reliability],
        durability=_DURABILITY[profile.durability],
        depth=profile.depth,
        deadline_ns=_to_ns(profile.deadline_s),
        lifespan_ns=_to_ns(profile.lifespan_s),
        liveliness=_LIVELINESS[profile.liveliness],
        liveliness_lease_ns=_to_ns(profile.liveliness_lease_s),
    )


def qos_from_proto(message: ros.QosPolicies) -> qos.QosProfile:
    """A peer's profile; what it left out or what this version does not know is the default."""
    default = qos.DEFAULT
    return qos.QosProfile(
        depth=min(message.depth, qos.MAX_DEPTH) or default.depth,
        reliability=_RELIABILITY_BACK.get(message.reliability, default.reliability),
        durability=_DURABILITY_BACK.get(message.durability, default.durability),
        deadline_s=_from_ns(message.deadline_ns),
        lifespan_s=_from_ns(message.lifespan_ns),
        liveliness=_LIVELINESS_BACK.get(message.liveliness, default.liveliness),
        liveliness_lease_s=_from_ns(message.liveliness_lease_ns),
    )


def _to_ns(seconds: float | None) -> int:
    return 0 if seconds is None else round(seconds * _NS)


def _from_ns(nanoseconds: int) -> float | None:
    return nanoseconds / _NS if nanoseconds > 0 else None


def snapshot_to_proto(
    nodes: Iterable[GraphNode], services: Iterable[GraphService] = ()
) -> master.GraphSnapshot:
    """Edges are left out: they follow from the nodes."""
    return master.GraphSnapshot(
        nodes=[
            master.GraphNode(
                node_info=ros.NodeInfo(ip=node.ip, port=node.port, node_name=node.name),
                publishes=[_topic_to_proto(key) for key in node.publishes],
                subscribes=[_topic_to_proto(key) for key in node.subscribes],
            )
            for node in nodes
        ],
        services=[
            master.GraphService(name=item.name, type_name=item.type_name, node_name=item.node)
            for item in services
        ],
    )


def snapshot_from_proto(message: master.GraphSnapshot) -> GraphSnapshot:
    """The whole graph, edges included."""
    nodes = tuple(
        GraphNode(
            node.node_info.node_name,
            node.node_info.ip,
            node.node_info.port,
            tuple(_topic_from_proto(topic) for topic in node.publishes),
            tuple(_topic_from_proto(topic) for topic in node.subscribes),
        )
        for node in message.nodes
    )
    services = tuple(
        GraphService(item.name, item.type_name, item.node_name) for item in message.services
    )
    return GraphSnapshot(nodes, edges_between(nodes), services)


def change_to_proto(change: GraphChange) -> master.GraphChange:
    """One change of the graph."""
    message = master.GraphChange(
        kind=master.GraphChangeKind.Value(change.kind.name),
        node_info=ros.NodeInfo(ip=change.ip, port=change.port, node_name=change.node),
    )
    if change.key is not None:
        message.topic.CopyFrom(_topic_to_proto(change.key))
    return message


def change_from_proto(message: master.GraphChange) -> GraphChange:
    """One change of the graph.

    Raises:
        ValueError: The kind is not known to this version.
    """
    try:
        kind = ChangeKind[master.GraphChangeKind.Name(message.kind)]
    except KeyError:
        raise ValueError(f"unknown graph change {message.kind}") from None
    return GraphChange(
        kind,
        message.node_info.node_name,
        message.node_info.ip,
        message.node_info.port,
        _topic_from_proto(message.topic) if message.HasField("topic") else None,
    )


def _topic_to_proto(key: TopicKey) -> ros.TopicInfo:
    return ros.TopicInfo(topic_name=key.topic, msg_type=key.msg_type)


def _topic_from_proto(message: ros.TopicInfo) -> TopicKey:
    return TopicKey(message.topic_name, message.msg_type)
