"""The Master's brain: requests in, answers and effects out.

Pure: it holds what is registered and decides what follows, and its shell carries the effects out
in the order given. A call has changed all it changes before any effect is handed over. No input
makes it raise.

Names. Topics and nodes are matched in canonical form, without leading slash, and every peer keeps
its own spelling: a push names the topic as its publisher does, and tells a node of ours how each
subscriber spells it. If a node spells one topic in two ways, the last one counts. Two foreign nodes
that disagree on a spelling have an edge in the graph but are not brought together: neither would
understand the other.

Identity. A node is an instance id, or for foreign nodes an address, under a name. Whoever comes
later under a taken name replaces the older node; a replaced instance is refused from then on, also
one that was out of reach while its successor came.
Nameless nodes cannot be told apart: they share one entry and are never dialled.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TypeAlias

from simple_ros.graph import TopicKey
from simple_ros.names import canonical
from simple_ros.rpc import master_pb2 as master
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros_master.conflicts import qos_notices, type_conflict, type_notices
from simple_ros_master.graph import MessageGraph, Role
from simple_ros_master.matching import announcements, full_update
from simple_ros_master.peers import (
    Address,
    CloseLink,
    Effect,
    EndLease,
    Endpoint,
    Notice,
    Peer,
    Push,
    Watch,
)

__all__ = ["Directory"]

REMEMBERED_INSTANCES = 10_000
"""How many replaced instances are refused before the oldest is forgotten."""

_Registration: TypeAlias = ros.RegisterPublisherRequest | ros.SubscribeRequest
_Goodbye: TypeAlias = ros.UnregisterPublisherRequest | ros.UnsubscribeRequest


@dataclass(frozen=True, slots=True)
class _Refusal:
    reason: str
    conflict: ros.TypeConflict | None = None


class Directory:
    """Everything that is registered with one Master.

    Args:
        master_id: Differs for every start of a Master.
        master_version: Shown to nodes that open a lease.
    """

    def __init__(self, master_id: str = "", master_version: str = "") -> None:
        self.graph = MessageGraph()
        self._granted = master.LeaseEvent(
            granted=master.LeaseGranted(master_id=master_id, master_version=master_version)
        )
        self._peers: dict[str, Peer] = {}
        self._at: dict[Address, dict[str, None]] = {}
        self._leases: dict[int, str] = {}
        self._superseded: OrderedDict[str, None] = OrderedDict()
        self._holders: OrderedDict[str, str] = OrderedDict()
        self._effects: list[Effect] = []

    @property
    def peers(self) -> Mapping[str, Peer]:
        """Every known node by canonical name, to read."""
        return MappingProxyType(self._peers)

    # -- registration --------------------------------------------------------------------------

    def register_publisher(
        self, request: ros.RegisterPublisherRequest
    ) -> tuple[ros.RegisterPublisherResponse, list[Effect]]:
        """A node publishes a topic: it is pushed the whole list of subscribers."""
        key = _key(request)
        done = self._register(Role.PUBLISHER, request, key)
        if isinstance(done, _Refusal):
            message = f"Register publisher refused: {done.reason}"
            refused = ros.RegisterPublisherResponse(message=message, type_conflict=done.conflict)
            return refused, self._taken()
        update = self._push_all(done, key)
        answer = ros.RegisterPublisherResponse(
            success=True,
            message="Register publisher success",
            subscribers=update.add_targets if done.ours else (),
        )
        return answer, self._taken()

    def subscribe(
        self, request: ros.SubscribeRequest
    ) -> tuple[ros.SubscribeResponse, list[Effect]]:
        """A node subscribes a topic: its publishers are pushed the new target."""
        key = _key(request)
        done = self._register(Role.SUBSCRIBER, request, key)
        if isinstance(done, _Refusal):
            message = f"Subscribe refused: {done.reason}"
            refused = ros.SubscribeResponse(message=message, type_conflict=done.conflict)
            return refused, self._taken()
        self._announce(done, key, joined=True)
        return ros.SubscribeResponse(success=True, message="Subscribe success"), self._taken()

    def unsubscribe(
        self, request: ros.UnsubscribeRequest
    ) -> tuple[ros.UnsubscribeResponse, list[Effect]]:
        """A node no longer subscribes: its publishers are pushed to drop it."""
        self._unregister(Role.SUBSCRIBER, request)
        return ros.UnsubscribeResponse(success=True, message="Unsubscribe success"), self._taken()

    def unregister_publisher(
        self, request: ros.UnregisterPublisherRequest
    ) -> tuple[ros.UnregisterPublisherResponse, list[Effect]]:
        """A node no longer publishes; nobody needs to be told."""
        self._unregister(Role.PUBLISHER, request)
        answer = ros.UnregisterPublisherResponse(
            success=True, message="Unregister publisher success"
        )
        return answer, self._taken()

    # -- life and death ------------------------------------------------------------------------

    def open_lease(self, lease: int, info: ros.NodeInfo) -> list[Effect]:
        """A node opens the lease that the shell numbered ``lease``: granted, or ended at once."""
        newcomer = Peer.described(info)
        if not newcomer.instance_id:
            self._effects.append(EndLease(lease, "a lease needs node_name and instance_id"))
        elif newcomer.instance_id in self._superseded:
            holder = self._peers.get(newcomer.name)
            self._end_taken(lease, holder.info() if holder else ros.NodeInfo())
        else:
            self._make_room(newcomer)
            self._grant(lease, self._enter(newcomer))
        return self._taken()

    def _grant(self, lease: int, peer: Peer) -> None:
        if peer.lease is not None:
            del self._leases[peer.lease]
            self._effects.append(EndLease(peer.lease))
        peer.lease = lease
        self._leases[lease] = peer.name
        self.graph.keep_node(peer.name)
        self._rewatch(peer.address)
        self._effects.append(Notice(lease, self._granted))

    def close_lease(self, lease: int) -> list[Effect]:
        """A lease ended, by a goodbye or by itself: its node is gone. Others are no matter."""
        name = self._leases.get(lease)
        if name is not None:
            self._remove(self._peers[name])
        return self._taken()

    def address_dead(self, address: Address) -> list[Effect]:
        """Nobody listens at a watched address: the nodes there that hold no lease are gone."""
        for name in list(self._at.get(address, ())):
            if self._peers[name].lease is None:
                self._remove(self._peers[name])
        return self._taken()

    def resync(self, address: Address) -> list[ros.TopicTargetsUpdate]:
        """All that the nodes at an address should have been pushed by now."""
        return [
            full_update(self.graph, self._peers, self._peers[name], key, snapshot=True)
            for name in self._at.get(address, ())
            for key in self._peers[name].endpoints[Role.PUBLISHER]
        ]

    # -- what registrations share --------------------------------------------------------------

    def _register(self, role: Role, request: _Registration, key: TopicKey) -> Peer | _Refusal:
        newcomer = Peer.described(request.node_info)
        if newcomer.instance_id in self._superseded:
            return _Refusal(f"a newer node took the name {newcomer.name!r}")
        self._make_room(newcomer)
        if request.strict and not self._has(role, newcomer.name, key):
            conflict = type_conflict(self.graph, key)
            if conflict is not None:
                reason = f"topic {key.topic!r} has type {conflict.existing_type}"
                return _Refusal(reason, conflict)
        peer = self._enter(newcomer)
        self._settle(role, peer, key, Endpoint.declared(request.topic_name, request.node_info))
        return peer

    def _has(self, role: Role, name: str, key: TopicKey) -> bool:
        return name in self._peers and key in self._peers[name].endpoints[role]

    def _settle(self, role: Role, peer: Peer, key: TopicKey, endpoint: Endpoint) -> None:
        previous = peer.endpoints[role].get(key)
        peer.endpoints[role][key] = endpoint
        self._effects += self.graph.add(role, peer.name, key)
        if peer.lease is None:
            self._rewatch(peer.address)
        if previous is None and key not in peer.endpoints[role.opposite]:
            self._effects += type_notices(self.graph, self._peers, peer, key)
        if previous is None or previous.profile != endpoint.profile:
            self._effects += qos_notices(self.graph, self._peers, role, peer, key)

    def _unregister(self, role: Role, request: _Goodbye) -> None:
        key, signed = _key(request), Peer.described(request.node_info)
        if not self._has(role, signed.name, key):
            return
        peer = self._peers[signed.name]
        if not peer.may_leave_as(signed):
            return
        if role is Role.SUBSCRIBER:
            self._announce(peer, key, joined=False)
        del peer.endpoints[role][key]
        self._effects += self.graph.remove(role, peer.name, key)
        if peer.name not in self.graph:
            self._forget(peer)

    # -- who is who ----------------------------------------------------------------------------

    def _make_room(self, newcomer: Peer) -> None:
        """Remove the node that has the newcomer's name, unless they are the same."""
        holder = self._peers.get(newcomer.name)
        if holder is None or holder.is_same(newcomer):
            return
        lease = holder.lease
        self._remove(holder)
        if lease is not None:
            self._end_taken(lease, newcomer.info())

    def _supersede(self, newcomer: Peer) -> None:
        """Refuse from now on who last had the newcomer's name, even if it is away just now."""
        previous = self._holders.pop(newcomer.name, newcomer.instance_id)
        if previous != newcomer.instance_id:
            self._superseded[previous] = None
        if newcomer.instance_id:
            self._holders[newcomer.name] = newcomer.instance_id
        for remembered in (self._superseded, self._holders):
            if len(remembered) > REMEMBERED_INSTANCES:
                remembered.popitem(last=False)

    def _end_taken(self, lease: int, taken_by: ros.NodeInfo) -> None:
        event = master.LeaseEvent(name_taken=master.NameTaken(taken_by=taken_by))
        self._effects += [Notice(lease, event), EndLease(lease)]

    def _enter(self, newcomer: Peer) -> Peer:
        """The known node that the newcomer is, or the newcomer, made known."""
        peer = self._peers.setdefault(newcomer.name, newcomer)
        if peer is newcomer:
            self._supersede(peer)
            self._effects += self.graph.upsert_node(peer.name, *peer.address)
            self._arrive(peer)
        elif newcomer.address != peer.address and newcomer.address.reachable:
            self._relocate(peer, newcomer)
        peer.further = newcomer.further or peer.further
        return peer

    def _relocate(self, peer: Peer, newcomer: Peer) -> None:
        """The same node listens somewhere else from now on."""
        for key in peer.endpoints[Role.SUBSCRIBER]:
            self._announce(peer, key, joined=False)
        self._depart(peer)
        peer.address, peer.further = newcomer.address, newcomer.further
        self._arrive(peer)
        self._effects += self.graph.upsert_node(peer.name, *peer.address)
        for key in peer.endpoints[Role.PUBLISHER]:
            self._push_all(peer, key)
        for key in peer.endpoints[Role.SUBSCRIBER]:
            self._announce(peer, key, joined=True)

    def _remove(self, peer: Peer) -> None:
        """A node is gone with all it registered: the others are told."""
        for key in peer.endpoints[Role.SUBSCRIBER]:
            self._announce(peer, key, joined=False, but=peer.name)
        self._effects += self.graph.remove_node(peer.name)
        self._forget(peer)

    def _forget(self, peer: Peer) -> None:
        del self._peers[peer.name]
        if peer.lease is not None:
            del self._leases[peer.lease]
        self._depart(peer)

    def _arrive(self, peer: Peer) -> None:
        if peer.pushable:
            self._at.setdefault(peer.address, {})[peer.name] = None

    def _depart(self, peer: Peer) -> None:
        if peer.pushable:
            names = self._at[peer.address]
            del names[peer.name]
            if names:
                self._rewatch(peer.address)
            else:
                del self._at[peer.address]
                self._effects.append(CloseLink(peer.address))

    def _rewatch(self, address: Address) -> None:
        names = self._at.get(address)
        if names:
            unleased = any(self._peers[name].lease is None for name in names)
            self._effects.append(Watch(address, unleased))

    # -- effects -------------------------------------------------------------------------------

    def _announce(
        self, subscriber: Peer, key: TopicKey, *, joined: bool, but: str | None = None
    ) -> None:
        self._effects += announcements(
            self.graph, self._peers, subscriber, key, joined=joined, but=but
        )

    def _push_all(self, publisher: Peer, key: TopicKey) -> ros.TopicTargetsUpdate:
        update = full_update(self.graph, self._peers, publisher, key)
        if publisher.pushable:
            self._effects.append(Push(publisher.address, update))
        return update

    def _taken(self) -> list[Effect]:
        effects, self._effects = self._effects, []
        return effects


def _key(request: _Registration | _Goodbye) -> TopicKey:
    return TopicKey(canonical(request.topic_name), request.msg_type)
