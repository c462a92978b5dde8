"""What the Master knows of one node, and the values it hands to its shell.

Pure. A *peer* is a node as it described itself; those without an instance id are *foreign* (C++
simple_ros) and are told only what C++ understands.
"""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple, TypeAlias

from simple_ros.graph import GraphChange, TopicKey
from simple_ros.names import canonical
from simple_ros.qos import QosProfile
from simple_ros.rpc import master_pb2 as master
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros.rpc.convert import qos_from_proto
from simple_ros_master.graph import Role

__all__ = [
    "Address",
    "CloseLink",
    "Effect",
    "EndLease",
    "Endpoint",
    "Notice",
    "Peer",
    "Push",
    "Watch",
]


class Address(NamedTuple):
    """Where a node listens."""

    ip: str
    port: int

    def __str__(self) -> str:
        ip = self.ip if _is_literal(self.ip) else repr(self.ip)
        return f"[{ip}]:{self.port}" if ":" in ip else f"{ip}:{self.port}"

    @property
    def reachable(self) -> bool:
        """Whether publishers have something to dial."""
        return bool(self.ip) and 0 < self.port <= 65535

    @property
    def dialable(self) -> bool:
        """Whether the Master dials it: a literal IP address, so that no name look-up ever waits."""
        return self.reachable and _is_literal(self.ip)


@lru_cache(maxsize=1024)
def _is_literal(ip: str) -> bool:
    try:
        ipaddress.ip_address(ip)
    except ValueError:
        return False
    return True


@dataclass(frozen=True, slots=True)
class Push:
    """Send an update to the node that listens at an address."""

    address: Address
    update: ros.TopicTargetsUpdate


@dataclass(frozen=True, slots=True)
class Watch:
    """Connect to an address and say when nobody listens there; ``on=False`` wants no verdict."""

    address: Address
    on: bool


@dataclass(frozen=True, slots=True)
class CloseLink:
    """No node is left at an address."""

    address: Address


@dataclass(frozen=True, slots=True)
class Notice:
    """Tell the holder of a lease something."""

    lease: int
    event: master.LeaseEvent


@dataclass(frozen=True, slots=True)
class EndLease:
    """End a lease's stream; ``error`` says what was wrong with its opening, empty for no error."""

    lease: int
    error: str = ""


Effect: TypeAlias = Push | Watch | CloseLink | Notice | EndLease | GraphChange


@dataclass(frozen=True, slots=True)
class Endpoint:
    """One publisher or subscription as its node declared it; no profile fits with everything."""

    topic: str
    policies: ros.QosPolicies | None = None
    profile: QosProfile | None = None

    @classmethod
    def declared(cls, topic: str, info: ros.NodeInfo) -> Endpoint:
        """From a registration: the node's own spelling and, if told, its QoS."""
        if not info.endpoint.HasField("qos"):
            return cls(topic)
        policies = ros.QosPolicies()
        policies.CopyFrom(info.endpoint.qos)
        return cls(topic, policies, qos_from_proto(policies))


@dataclass(slots=True)
class Peer:
    """A node: canonical name, where it listens, which lease it holds, its endpoints by role."""

    name: str
    address: Address
    instance_id: str = ""
    further: tuple[str, ...] = ()
    lease: int | None = None
    endpoints: tuple[dict[TopicKey, Endpoint], dict[TopicKey, Endpoint]] = field(
        default_factory=lambda: ({}, {})
    )

    @classmethod
    def described(cls, info: ros.NodeInfo) -> Peer:
        """From a node's description of itself; one without a name has no identity either."""
        name = canonical(info.node_name)
        instance_id = info.instance_id if name else ""
        return cls(name, Address(info.ip, info.port), instance_id, tuple(info.addresses))

    @property
    def ours(self) -> bool:
        """Whether it understands what we add to the C++ messages."""
        return bool(self.instance_id)

    @property
    def pushable(self) -> bool:
        """Whether it can be dialled: nameless nodes and those without an address cannot."""
        return bool(self.name) and self.address.dialable

    def is_same(self, other: Peer) -> bool:
        """Whether ``other``, who came later under the same name, is this very node."""
        if not self.name:
            return True
        if other.instance_id:
            return other.instance_id == self.instance_id
        return other.address == self.address

    def may_leave_as(self, other: Peer) -> bool:
        """Whether a goodbye signed by ``other`` is this node's own."""
        known = self.instance_id and other.instance_id
        return other.address == self.address and (not known or self.is_same(other))

    def understands(self, other: Peer, key: TopicKey) -> bool:
        """Whether this publisher's frames name the topic so that subscriber ``other`` knows it.

        Our nodes take and send any spelling; two foreign ones must agree on it.
        """
        if self.ours or other.ours:
            return True
        mine, theirs = self.endpoints[Role.PUBLISHER], other.endpoints[Role.SUBSCRIBER]
        return mine[key].topic == theirs[key].topic

    def info(self) -> ros.NodeInfo:
        """The node as answers to queries show it."""
        ip, port = self.address
        return ros.NodeInfo(
            ip=ip,
            port=port,
            node_name=self.name,
            instance_id=self.instance_id,
            addresses=self.further,
        )

    def plain_info(self) -> ros.NodeInfo:
        """The node as C++ describes nodes."""
        return ros.NodeInfo(ip=self.address.ip, port=self.address.port, node_name=self.name)

    def info_with(self, role: Role, key: TopicKey) -> ros.NodeInfo:
        """The node with one of its endpoints."""
        endpoint = self.endpoints[role][key]
        info = self.info()
        info.endpoint.topic = endpoint.topic
        info.endpoint.msg_type = key.msg_type
        if endpoint.policies is not None:
            info.endpoint.qos.CopyFrom(endpoint.policies)
        return info
