"""Which updates bring publishers and subscribers together.

Pure functions of the graph and the peers. Publishers of ours learn everything about a target; C++
publishers get the three fields they know, byte for byte as from a C++ Master.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from simple_ros.graph import TopicKey
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros_master.graph import MessageGraph, Role
from simple_ros_master.peers import Address, Peer, Push

__all__ = ["announcements", "full_update"]

Peers = Mapping[str, Peer]


def full_update(
    graph: MessageGraph, peers: Peers, publisher: Peer, key: TopicKey, *, snapshot: bool = False
) -> ros.TopicTargetsUpdate:
    """Every subscriber of what a node publishes, in the order they came."""
    subscribers = (peers[name] for name in graph.at(Role.SUBSCRIBER, key))
    return ros.TopicTargetsUpdate(
        topic=publisher.endpoints[Role.PUBLISHER][key].topic,
        add_targets=[
            _target(publisher, subscriber, key)
            for subscriber in subscribers
            if _meet(publisher, subscriber, key)
        ],
        snapshot=snapshot,
    )


def announcements(
    graph: MessageGraph,
    peers: Peers,
    subscriber: Peer,
    key: TopicKey,
    *,
    joined: bool,
    but: str | None = None,
) -> Iterator[Push]:
    """A subscriber's coming or going, once for each place that publishes the topic.

    Args:
        graph: With the subscriber in it.
        peers: The nodes of the graph.
        subscriber: Who comes or goes.
        key: What it subscribes.
        joined: Whether it comes.
        but: A node that is not told.
    """
    told: set[tuple[Address, str]] = set()
    for name in graph.at(Role.PUBLISHER, key):
        publisher = peers[name]
        topic = publisher.endpoints[Role.PUBLISHER][key].topic
        place = (publisher.address, topic)
        if not publisher.pushable or name == but or place in told:
            continue
        if _meet(publisher, subscriber, key):
            told.add(place)
            update = ros.TopicTargetsUpdate(topic=topic)
            targets = update.add_targets if joined else update.remove_targets
            targets.append(_target(publisher, subscriber, key))
            yield Push(publisher.address, update)


def _meet(publisher: Peer, subscriber: Peer, key: TopicKey) -> bool:
    return subscriber.address.reachable and publisher.understands(subscriber, key)


def _target(publisher: Peer, subscriber: Peer, key: TopicKey) -> ros.NodeInfo:
    return subscriber.info_with(Role.SUBSCRIBER, key) if publisher.ours else subscriber.plain_info()
