"""The graph of nodes as clients see it: topics with one type each, services, who is linked to whom. Pure."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from simple_ros.foxglove import frames
from simple_ros.graph import ChangeKind, GraphChange, GraphService, GraphSnapshot, TopicKey
from simple_ros.names import canonical

__all__ = ["ConnectionGraph", "GraphModel", "difference", "shown"]

Ends = dict[str, tuple[str, ...]]


def shown(name: str) -> str:
    """A name as clients see it: with a leading slash."""
    return f"/{canonical(name)}"


@dataclass(frozen=True, slots=True)
class ConnectionGraph:
    """Node names by topic and by service; all names with a leading slash."""

    published: Ends = field(default_factory=dict)
    subscribed: Ends = field(default_factory=dict)
    services: Ends = field(default_factory=dict)

    def frame(self) -> str:
        """All of it, for a client that knows nothing yet."""
        return frames.graph_update(self.published, self.subscribed, self.services)


def difference(before: ConnectionGraph, after: ConnectionGraph) -> str | None:
    """The frame that makes the one graph the other; None if they are equal."""
    published = _changed(before.published, after.published)
    subscribed = _changed(before.subscribed, after.subscribed)
    services = _changed(before.services, after.services)
    topics_before = before.published.keys() | before.subscribed.keys()
    topics_after = after.published.keys() | after.subscribed.keys()
    removed = sorted(topics_before - topics_after)
    for gone in removed:
        published.pop(gone, None)
        subscribed.pop(gone, None)
    removed_services = sorted(before.services.keys() - after.services.keys())
    for gone in removed_services:
        services.pop(gone, None)
    if not (published or subscribed or services or removed or removed_services):
        return None
    return frames.graph_update(published, subscribed, services, removed, removed_services)


def _changed(before: Ends, after: Ends) -> Ends:
    """What is different; nobody for a name that has gone from this list."""
    names = before.keys() | after.keys()
    return {
        name: after.get(name, ()) for name in sorted(names) if before.get(name) != after.get(name)
    }


class GraphModel:
    """Follows what `MasterClient.watch_graph` tells.

    Attributes:
        services: Services by canonical name.
    """

    def __init__(self) -> None:
        self.services: dict[str, GraphService] = {}
        self._publishers: dict[TopicKey, set[str]] = {}
        self._subscribers: dict[TopicKey, set[str]] = {}
        self._types: dict[str, str] = {}

    def take(self, item: GraphSnapshot | GraphChange) -> None:
        """Take in what the Master said."""
        if isinstance(item, GraphSnapshot):
            self._replace(item)
        elif item.key is not None:
            self._change(item.kind, item.key, item.node)

    def _replace(self, graph: GraphSnapshot) -> None:
        self._publishers = _ends({node.name: node.publishes for node in graph.nodes})
        self._subscribers = _ends({node.name: node.subscribes for node in graph.nodes})
        self.services = {canonical(service.name): service for service in graph.services}

    def _change(self, kind: ChangeKind, key: TopicKey, node: str) -> None:
        match kind:
            case ChangeKind.PUBLISHER_ADDED:
                self._publishers.setdefault(_plain(key), set()).add(node)
            case ChangeKind.PUBLISHER_REMOVED:
                _discard(self._publishers, _plain(key), node)
            case ChangeKind.SUBSCRIBER_ADDED:
                self._subscribers.setdefault(_plain(key), set()).add(node)
            case ChangeKind.SUBSCRIBER_REMOVED:
                _discard(self._subscribers, _plain(key), node)
            case ChangeKind.SERVICE_ADDED:
                self.services[canonical(key.topic)] = GraphService(key.topic, key.msg_type, node)
            case ChangeKind.SERVICE_REMOVED:
                self.services.pop(canonical(key.topic), None)

    def published(self) -> dict[str, str]:
        """Types by topic, for topics that somebody publishes.

        Of a topic with several types, which nodes of other implementations can make, that is kept
        which it was before, as long as there is somebody who publishes it.
        """
        found: dict[str, set[str]] = defaultdict(set)
        for key in self._publishers:
            found[key.topic].add(key.msg_type)
        self._types = {
            topic: self._types[topic] if self._types.get(topic) in types else min(types)
            for topic, types in found.items()
        }
        return dict(self._types)

    def type_of(self, topic: str) -> str | None:
        """The type that publishers or else subscribers of a topic use; None if there are none."""
        name = canonical(topic)
        for ends in (self._publishers, self._subscribers):
            types = [key.msg_type for key in ends if key.topic == name]
            if types:
                return self._types.get(name) if self._types.get(name) in types else min(types)
        return None

    def subscribers_of(self, topic: str, msg_type: str) -> frozenset[str]:
        """Names of the nodes that subscribe to a topic."""
        return frozenset(self._subscribers.get(TopicKey(canonical(topic), msg_type), ()))

    def publishers_of(self, topic: str, msg_type: str) -> frozenset[str]:
        """Names of the nodes that publish a topic."""
        return frozenset(self._publishers.get(TopicKey(canonical(topic), msg_type), ()))

    def connections(
        self,
        wants: Callable[[str], bool],
        wants_service: Callable[[str], bool] = lambda _: True,
    ) -> ConnectionGraph:
        """Who is linked to whom by the topics and services that are wanted."""
        services: Ends = {
            shown(name): (shown(item.node),)
            for name, item in sorted(self.services.items())
            if wants_service(name)
        }
        return ConnectionGraph(
            _by_topic(self._publishers, wants), _by_topic(self._subscribers, wants), services
        )


def _plain(key: TopicKey) -> TopicKey:
    return TopicKey(canonical(key.topic), key.msg_type)


def _ends(by_node: Mapping[str, tuple[TopicKey, ...]]) -> dict[TopicKey, set[str]]:
    found: dict[TopicKey, set[str]] = {}
    for node, keys in by_node.items():
        for key in keys:
            found.setdefault(_plain(key), set()).add(node)
    return found


def _discard(ends: dict[TopicKey, set[str]], key: TopicKey, node: str) -> None:
    nodes = ends.get(key, set())
    nodes.discard(node)
    if not nodes:
        ends.pop(key, None)


def _by_topic(ends: dict[TopicKey, set[str]], wants: Callable[[str], bool]) -> Ends:
    found: dict[str, set[str]] = defaultdict(set)
    for key, nodes in ends.items():
        if wants(key.topic):
            found[shown(key.topic)] |= {shown(node) for node in nodes}
    return {topic: tuple(sorted(nodes)) for topic, nodes in sorted(found.items())}
