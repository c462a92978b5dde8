"""The message graph as values: what the Master shows and tools read.

The Master's own mutable graph lives in `simple_ros_master.graph`; here are the frozen snapshot and
change values that travel, and the three print-outs of C++ simple_ros (readable text, DOT, JSON) as
functions of a snapshot. Nodes are ordered by name, edges by (source, destination, topic), so equal
graphs print equal.
"""

from __future__ import annotations

import json
from collections import defaultdict
from dataclasses import dataclass
from enum import Enum

__all__ = [
    "ChangeKind",
    "GraphChange",
    "GraphEdge",
    "GraphNode",
    "GraphService",
    "GraphSnapshot",
    "TopicKey",
    "edges_between",
    "to_dot",
    "to_json",
    "to_readable_string",
]


@dataclass(frozen=True, slots=True, order=True)
class TopicKey:
    """A topic with its message type; publishers and subscribers meet when both are equal."""

    topic: str
    msg_type: str


@dataclass(frozen=True, slots=True)
class GraphNode:
    """One node: canonical name, address that peers dial, sorted topics."""

    name: str
    ip: str = ""
    port: int = 0
    publishes: tuple[TopicKey, ...] = ()
    subscribes: tuple[TopicKey, ...] = ()


@dataclass(frozen=True, slots=True, order=True)
class GraphEdge:
    """Messages of one topic flow from node ``src`` to node ``dst``."""

    src: str
    dst: str
    key: TopicKey


@dataclass(frozen=True, slots=True, order=True)
class GraphService:
    """A service, the name of its type and of the node that provides it."""

    name: str
    type_name: str
    node: str


class ChangeKind(Enum):
    """What happened to the graph."""

    NODE_ADDED = "node_added"
    NODE_REMOVED = "node_removed"
    PUBLISHER_ADDED = "publisher_added"
    PUBLISHER_REMOVED = "publisher_removed"
    SUBSCRIBER_ADDED = "subscriber_added"
    SUBSCRIBER_REMOVED = "subscriber_removed"
    SERVICE_ADDED = "service_added"
    SERVICE_REMOVED = "service_removed"


@dataclass(frozen=True, slots=True)
class GraphChange:
    """One change; ``key`` is None when it concerns a node as a whole.

    For a service, the key holds its name and the name of its type.
    """

    kind: ChangeKind
    node: str
    ip: str = ""
    port: int = 0
    key: TopicKey | None = None


@dataclass(frozen=True, slots=True)
class GraphSnapshot:
    """The whole graph at one moment, in print order."""

    nodes: tuple[GraphNode, ...] = ()
    edges: tuple[GraphEdge, ...] = ()
    services: tuple[GraphService, ...] = ()


def edges_between(nodes: tuple[GraphNode, ...]) -> tuple[GraphEdge, ...]:
    """The edges that follow from what the nodes publish and subscribe, in print order."""
    subscribers: dict[TopicKey, list[str]] = defaultdict(list)
    for node in nodes:
        for key in node.subscribes:
            subscribers[key].append(node.name)
    return tuple(
        sorted(
            GraphEdge(node.name, name, key)
            for node in nodes
            for key in node.publishes
            for name in subscribers.get(key, ())
        )
    )


def to_readable_string(graph: GraphSnapshot) -> str:
    """Text for people, in the format of C++ ``MessageGraph::ToReadableString``."""
    lines = [
        "==== Message Graph ====",
        f"Nodes: {len(graph.nodes)}, Edges: {len(graph.edges)}",
        "",
        "[Nodes]",
    ]
    for node in graph.nodes:
        lines.append(f" - {node.name} (ip={node.ip}, port={node.port})")
        for title, keys in (("publishes", node.publishes), ("subscribes", node.subscribes)):
            if keys:
                lines.append(f"    {title}:")
                lines.extend(f"      - {key.topic} : {key.msg_type}" for key in keys)
    lines += ["", "[Edges]"]
    lines.extend(
        f" - {edge.src} -> {edge.dst}  [{edge.key.topic} : {edge.key.msg_type}]"
        for edge in graph.edges
    )
    return "\n".join(lines) + "\n"


def to_dot(graph: GraphSnapshot) -> str:
    """Graphviz text, in the format of C++ ``MessageGraph::ToDOT``; quotes in names are escaped."""
    lines = ["digraph RosGraph {", "  rankdir=LR;", "  node [shape=box, style=rounded];"]
    lines.extend(f'  "{_dot(node.name)}";' for node in graph.nodes)
    lines.extend(
        f'  "{_dot(edge.src)}" -> "{_dot(edge.dst)}" '
        f'[label="{_dot(edge.key.topic)}\\n{_dot(edge.key.msg_type)}"];'
        for edge in graph.edges
    )
    return "\n".join([*lines, "}"]) + "\n"


def _dot(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"', '\\"')


def to_json(graph: GraphSnapshot) -> str:
    """JSON, in the format of C++ ``MessageGraph::ToJSON``: sorted keys, two spaces, no last newline."""
    document = {
        "nodes": [
            {
                "name": node.name,
                "ip": node.ip,
                "port": node.port,
                "publishes": _topics(node.publishes),
                "subscribes": _topics(node.subscribes),
            }
            for node in graph.nodes
        ],
        "edges": [
            {
                "src": edge.src,
                "dst": edge.dst,
                "topic": edge.key.topic,
                "msg": edge.key.msg_type,
            }
            for edge in graph.edges
        ],
    }
    return json.dumps(document, indent=2, sort_keys=True, ensure_ascii=False)


def _topics(keys: tuple[TopicKey, ...]) -> list[dict[str, str]]:
    return [{"topic": key.topic, "msg": key.msg_type} for key in keys]
