"""What a drawing of the graph shows: vertices and arrows, before anybody gives them a place.

Two views of one snapshot. `node_view` has a vertex for each node and one arrow for all topics that
flow from one node to another. `topic_view` is ROS's picture with two kinds of vertices: a node points
at the topics it publishes, a topic at the nodes that subscribe to it.

Names come from anybody on the network. `printable` makes them harmless for people; each writer
escapes for its own format.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from enum import Enum

from simple_ros.graph import GraphEdge, GraphNode, GraphSnapshot, TopicKey
from simple_ros.names import canonical

__all__ = ["Arrow", "Kind", "Vertex", "View", "filtered", "node_view", "printable", "topic_view"]


class Kind(Enum):
    """What a vertex stands for."""

    NODE = "node"
    TOPIC = "topic"


@dataclass(frozen=True, slots=True)
class Vertex:
    """One thing to draw.

    Attributes:
        id: Letters and digits only, unique in the view.
        kind: See `Kind`.
        name: As the Master tells it.
        detail: Address of a node, message type of a topic.
    """

    id: str
    kind: Kind
    name: str
    detail: str


@dataclass(frozen=True, slots=True)
class Arrow:
    """Messages flow from vertex ``src`` to vertex ``dst``; ``topics`` is empty beside topic vertices."""

    src: str
    dst: str
    topics: tuple[TopicKey, ...] = ()


@dataclass(frozen=True, slots=True)
class View:
    """What is drawn, in an order that equal graphs share."""

    vertices: tuple[Vertex, ...]
    arrows: tuple[Arrow, ...]


def node_view(graph: GraphSnapshot) -> View:
    """Nodes, and an arrow for each pair with messages between them."""
    ids = {node.name: f"n{index}" for index, node in enumerate(graph.nodes)}
    topics: dict[tuple[str, str], list[TopicKey]] = defaultdict(list)
    for edge in graph.edges:
        if edge.src in ids and edge.dst in ids:
            topics[ids[edge.src], ids[edge.dst]].append(edge.key)
    arrows = (Arrow(src, dst, tuple(keys)) for (src, dst), keys in topics.items())
    return View(_node_vertices(graph), tuple(arrows))


def topic_view(graph: GraphSnapshot) -> View:
    """Nodes and topics; a topic with two message types is two vertices."""
    keys = sorted({key for node in graph.nodes for key in (*node.publishes, *node.subscribes)})
    ids = {key: f"t{index}" for index, key in enumerate(keys)}
    arrows = []
    for index, node in enumerate(graph.nodes):
        arrows += [Arrow(f"n{index}", ids[key]) for key in node.publishes]
        arrows += [Arrow(ids[key], f"n{index}") for key in node.subscribes]
    topics = tuple(Vertex(ids[key], Kind.TOPIC, key.topic, key.msg_type) for key in keys)
    return View(_node_vertices(graph) + topics, tuple(arrows))


def _node_vertices(graph: GraphSnapshot) -> tuple[Vertex, ...]:
    return tuple(
        Vertex(f"n{index}", Kind.NODE, node.name, f"{node.ip}:{node.port}")
        for index, node in enumerate(graph.nodes)
    )


def filtered(graph: GraphSnapshot, text: str) -> GraphSnapshot:
    """The part of a graph that has to do with ``text``.

    A node whose name contains it is kept with all its topics and with the nodes at their other ends; a
    topic or service whose name contains it, with all nodes that use it. A leading slash means nothing.
    """
    wanted = canonical(text)
    edges = tuple(edge for edge in graph.edges if _concerns(edge, wanted))
    sent, received = defaultdict(set), defaultdict(set)
    for edge in edges:
        sent[edge.src].add(edge.key)
        received[edge.dst].add(edge.key)
    nodes = (_part(node, wanted, sent[node.name], received[node.name]) for node in graph.nodes)
    services = tuple(
        service for service in graph.services if wanted in service.name or wanted in service.node
    )
    providers = {service.node for service in services}
    kept = (
        node
        for node in nodes
        if wanted in node.name or node.publishes or node.subscribes or node.name in providers
    )
    return GraphSnapshot(tuple(kept), edges, services)


def _concerns(edge: GraphEdge, wanted: str) -> bool:
    return wanted in edge.src or wanted in edge.dst or wanted in edge.key.topic


def _part(node: GraphNode, wanted: str, sent: set[TopicKey], received: set[TopicKey]) -> GraphNode:
    if wanted in node.name:
        return node

    def kept(keys: tuple[TopicKey, ...], linked: set[TopicKey]) -> tuple[TopicKey, ...]:
        return tuple(key for key in keys if wanted in key.topic or key in linked)

    return replace(
        node, publishes=kept(node.publishes, sent), subscribes=kept(node.subscribes, received)
    )


def printable(text: str) -> str:
    """Text in which what is invisible or moves the cursor is written as a Python escape.

    That is control characters, line breaks, marks that turn the direction of writing, and lone surrogates.
    """
    if text.isprintable():
        return text
    return "".join(
        char if char.isprintable() else char.encode("unicode_escape").decode() for char in text
    )
