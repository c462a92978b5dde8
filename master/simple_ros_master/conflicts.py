"""Disagreements between nodes that use one topic: about its type, about quality of service.

Pure functions of the graph and the peers. Nobody but leased nodes can be told.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from simple_ros.graph import TopicKey
from simple_ros.qos import incompatibilities
from simple_ros.rpc import master_pb2 as master
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros_master.graph import MessageGraph, Role
from simple_ros_master.peers import Notice, Peer

__all__ = ["qos_notices", "type_conflict", "type_notices"]

Peers = Mapping[str, Peer]


def type_conflict(graph: MessageGraph, key: TopicKey) -> ros.TypeConflict | None:
    """Why a strict node may not use this type on this topic; None if it may.

    The type of a topic is the first that was registered and still is in use, so an intruder cannot
    lock out the nodes that agree.
    """
    types = graph.types_of(key.topic)
    if not types or types[0] == key.msg_type:
        return None
    users = graph.using(TopicKey(key.topic, types[0]))
    return ros.TypeConflict(existing_type=types[0], existing_nodes=users)


def type_notices(
    graph: MessageGraph, peers: Peers, newcomer: Peer, key: TopicKey
) -> Iterator[Notice]:
    """What to say when a node came with ``key`` to a topic that has other types as well."""
    told = {newcomer.name}
    for other in graph.types_of(key.topic):
        if other == key.msg_type:
            continue
        users = graph.using(TopicKey(key.topic, other))
        event = master.LeaseEvent(
            type_conflict=master.TypeConflictNotice(
                topic=key.topic,
                msg_type=key.msg_type,
                node_name=newcomer.name,
                existing_type=other,
                existing_nodes=users,
            )
        )
        yield from _notices([newcomer], event)
        yield from _notices([peers[name] for name in users if name not in told], event)
        told.update(users)


def qos_notices(
    graph: MessageGraph, peers: Peers, role: Role, newcomer: Peer, key: TopicKey
) -> Iterator[Notice]:
    """What to say to each pair that a new endpoint makes and whose profiles do not fit."""
    if newcomer.endpoints[role][key].profile is None:
        return
    for name in graph.at(role.opposite, key):
        pair = (newcomer, peers[name]) if role is Role.PUBLISHER else (peers[name], newcomer)
        event = _qos_conflict(*pair, key)
        if event is not None:
            yield from _notices({peer.name: peer for peer in pair}.values(), event)


def _qos_conflict(publisher: Peer, subscriber: Peer, key: TopicKey) -> master.LeaseEvent | None:
    offer = publisher.endpoints[Role.PUBLISHER][key]
    request = subscriber.endpoints[Role.SUBSCRIBER][key]
    if offer.profile is None or request.profile is None:
        return None
    if not incompatibilities(offer.profile, request.profile):
        return None
    return master.LeaseEvent(
        qos_conflict=master.QosConflictNotice(
            topic=key.topic,
            publisher=publisher.name,
            subscriber=subscriber.name,
            offered=offer.policies,
            requested=request.policies,
        )
    )


def _notices(peers: Iterable[Peer], event: master.LeaseEvent) -> Iterator[Notice]:
    for peer in peers:
        if peer.lease is not None:
            yield Notice(peer.lease, event)
