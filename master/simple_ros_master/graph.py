"""The message graph: who publishes and who subscribes what, and which nodes that connects.

Pure. Nodes are keyed by canonical name, topics by name and message type; an edge stands between a
publisher and a subscriber when both are equal. Every operation touches only what it concerns: a
registration costs the number of edges it makes, whatever the size of the rest. Operations never
raise: adding twice and removing what is unknown change nothing. Each returns the changes it caused,
in the order they happened.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import IntEnum

from simple_ros.graph import (
    ChangeKind,
    GraphChange,
    GraphEdge,
    GraphNode,
    GraphSnapshot,
    TopicKey,
    to_dot,
    to_json,
    to_readable_string,
)

__all__ = ["MessageGraph", "Role"]


class Role(IntEnum):
    """Which end of a topic; the number indexes pairs of tables."""

    PUBLISHER = 0
    SUBSCRIBER = 1

    @property
    def opposite(self) -> Role:
        """The other end."""
        return Role(1 - self)


_ADDED = (ChangeKind.PUBLISHER_ADDED, ChangeKind.SUBSCRIBER_ADDED)
_REMOVED = (ChangeKind.PUBLISHER_REMOVED, ChangeKind.SUBSCRIBER_REMOVED)


@dataclass(slots=True)
class _Node:
    """Dictionaries serve as sets that remember order."""

    ip: str = ""
    port: int = 0
    keep: bool = False
    topics: tuple[dict[TopicKey, None], dict[TopicKey, None]] = field(
        default_factory=lambda: ({}, {})
    )


@dataclass(slots=True)
class _Topic:
    """The nodes at both ends of one topic and type."""

    nodes: tuple[dict[str, None], dict[str, None]] = field(default_factory=lambda: ({}, {}))


class MessageGraph:
    """The mutable graph of a Master; see the module for its contract."""

    def __init__(self) -> None:
        self._nodes: dict[str, _Node] = {}
        self._topics: dict[str, dict[str, _Topic]] = {}
        self._edges: set[GraphEdge] = set()

    # -- nodes ---------------------------------------------------------------------------------

    def __contains__(self, name: object) -> bool:
        return name in self._nodes

    def __len__(self) -> int:
        return len(self._nodes)

    def upsert_node(self, name: str, ip: str = "", port: int = 0) -> list[GraphChange]:
        """Add a node, or give a known one its new address."""
        node = self._nodes.get(name)
        if node is not None and (node.ip, node.port) == (ip, port):
            return []
        if node is None:
            node = self._nodes[name] = _Node()
        node.ip, node.port = ip, port
        return [GraphChange(ChangeKind.NODE_ADDED, name, ip, port)]

    def keep_node(self, name: str) -> None:
        """Let a node stand even with no topics, until `remove_node`."""
        if name in self._nodes:
            self._nodes[name].keep = True

    def remove_node(self, name: str) -> list[GraphChange]:
        """Remove a node with all it publishes and subscribes."""
        node = self._nodes.get(name)
        if node is None:
            return []
        changes = [
            self._detach(role, name, node, key) for role in Role for key in list(node.topics[role])
        ]
        del self._nodes[name]
        return [*changes, GraphChange(ChangeKind.NODE_REMOVED, name, node.ip, node.port)]

    # -- topics --------------------------------------------------------------------------------

    def add_publisher(self, name: str, key: TopicKey) -> list[GraphChange]:
        """Note that a node publishes; an unknown node is added without an address."""
        return self.add(Role.PUBLISHER, name, key)

    def add_subscriber(self, name: str, key: TopicKey) -> list[GraphChange]:
        """Note that a node subscribes; an unknown node is added without an address."""
        return self.add(Role.SUBSCRIBER, name, key)

    def remove_publisher(self, name: str, key: TopicKey) -> list[GraphChange]:
        """Note that a node no longer publishes; a node left without topics goes too."""
        return self.remove(Role.PUBLISHER, name, key)

    def remove_subscriber(self, name: str, key: TopicKey) -> list[GraphChange]:
        """Note that a node no longer subscribes; a node left without topics goes too."""
        return self.remove(Role.SUBSCRIBER, name, key)

    def add(self, role: Role, name: str, key: TopicKey) -> list[GraphChange]:
        """`add_publisher` or `add_subscriber`."""
        changes = [] if name in self._nodes else self.upsert_node(name)
        node = self._nodes[name]
        if key in node.topics[role]:
            return changes
        topic = self._topics.setdefault(key.topic, {}).setdefault(key.msg_type, _Topic())
        node.topics[role][key] = None
        topic.nodes[role][name] = None
        self._edges.update(self._edges_of(role, name, key, topic))
        return [*changes, GraphChange(_ADDED[role], name, node.ip, node.port, key)]

    def remove(self, role: Role, name: str, key: TopicKey) -> list[GraphChange]:
        """`remove_publisher` or `remove_subscriber`."""
        node = self._nodes.get(name)
        if node is None or key not in node.topics[role]:
            return []
        changes = [self._detach(role, name, node, key)]
        if not node.keep and not any(node.topics):
            changes += self.remove_node(name)
        return changes

    def _detach(self, role: Role, name: str, node: _Node, key: TopicKey) -> GraphChange:
        types = self._topics[key.topic]
        topic = types[key.msg_type]
        self._edges.difference_update(self._edges_of(role, name, key, topic))
        del node.topics[role][key]
        del topic.nodes[role][name]
        if not any(topic.nodes):
            del types[key.msg_type]
            if not types:
                del self._topics[key.topic]
        return GraphChange(_REMOVED[role], name, node.ip, node.port, key)

    @staticmethod
    def _edges_of(role: Role, name: str, key: TopicKey, topic: _Topic) -> Iterator[GraphEdge]:
        for other in topic.nodes[role.opposite]:
            src, dst = (name, other) if role is Role.PUBLISHER else (other, name)
            yield GraphEdge(src, dst, key)

    # -- questions -----------------------------------------------------------------------------

    def publishers_of(self, topic: str, msg_type: str | None = None) -> tuple[str, ...]:
        """Names of the nodes that publish a topic, with one type or with any."""
        return self._names(Role.PUBLISHER, topic, msg_type)

    def subscribers_of(self, topic: str, msg_type: str | None = None) -> tuple[str, ...]:
        """Names of the nodes that subscribe a topic, with one type or with any."""
        return self._names(Role.SUBSCRIBER, topic, msg_type)

    def _names(self, role: Role, topic: str, msg_type: str | None) -> tuple[str, ...]:
        types = self._topics.get(topic, {})
        if msg_type is not None:
            found = types.get(msg_type)
            return tuple(found.nodes[role]) if found else ()
        return tuple(dict.fromkeys(name for entry in types.values() for name in entry.nodes[role]))

    def at(self, role: Role, key: TopicKey) -> tuple[str, ...]:
        """Names of the nodes at one end of a topic, in the order they came."""
        return self._names(role, key.topic, key.msg_type)

    def using(self, key: TopicKey) -> tuple[str, ...]:
        """Names of the nodes at either end of a topic, publishers first, each once."""
        return tuple(dict.fromkeys(name for role in Role for name in self.at(role, key)))

    def types_of(self, topic: str) -> tuple[str, ...]:
        """The types a topic is used with, the one that was there first in front."""
        return tuple(self._topics.get(topic, ()))

    def types_in_use(self) -> set[str]:
        """Every message type that some topic is used with."""
        return {msg_type for types in self._topics.values() for msg_type in types}

    def topics(self) -> Iterator[TopicKey]:
        """Every topic once, by name, with the first of its types."""
        for topic in sorted(self._topics):
            yield TopicKey(topic, next(iter(self._topics[topic])))

    def node(self, name: str) -> GraphNode | None:
        """One node with its topics sorted, or None."""
        node = self._nodes.get(name)
        if node is None:
            return None
        publishes, subscribes = (tuple(sorted(keys)) for keys in node.topics)
        return GraphNode(name, node.ip, node.port, publishes, subscribes)

    def nodes(self) -> Iterator[GraphNode]:
        """Every node, by name."""
        for name in sorted(self._nodes):
            node = self.node(name)
            if node is not None:
                yield node

    @property
    def edges(self) -> frozenset[GraphEdge]:
        """Every edge."""
        return frozenset(self._edges)

    # -- print-outs ----------------------------------------------------------------------------

    def snapshot(self) -> GraphSnapshot:
        """The whole graph as a value, in print order."""
        return GraphSnapshot(tuple(self.nodes()), tuple(sorted(self._edges)))

    def to_readable_string(self) -> str:
        """Text for people."""
        return to_readable_string(self.snapshot())

    def to_dot(self) -> str:
        """Graphviz text."""
        return to_dot(self.snapshot())

    def to_json(self) -> str:
        """JSON text."""
        return to_json(self.snapshot())
