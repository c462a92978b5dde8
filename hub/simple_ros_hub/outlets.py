"""What the hub publishes: numbered, below the engines' namespace."""

from __future__ import annotations

from typing import Any, Generic, TypeVar

from google.protobuf.message import Message

from simple_ros.msg.diagnostic_msgs import DiagnosticArray
from simple_ros.msg.std_msgs import String
from simple_ros.msg.wireless_ros_msgs import (
    Degradation,
    GlobalPolicy,
    ResourceGrants,
    ResourceOverview,
    SystemEvent,
    SystemStatus,
)
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher
from simple_ros.qos import LATCHED, QosProfile
from simple_ros_hub.components import NAMESPACE

__all__ = ["Outlet", "Outlets"]

MessageT = TypeVar("MessageT", bound=Message)


class Outlet(Generic[MessageT]):
    """A publisher that stamps and numbers its messages, which have a header."""

    def __init__(self, publisher: Publisher[MessageT], node: NodeHandle) -> None:
        self._publisher = publisher
        self._node = node
        self._seq = 0

    def publish(self, message: MessageT) -> None:
        """Stamp, number and send; a stamp it has already stays."""
        header: Any = message.header  # type: ignore[attr-defined]
        if not header.HasField("stamp"):
            header.stamp.FromNanoseconds(self._node.clock.now().nanoseconds)
        header.seq = self._seq
        self._seq = (self._seq + 1) & 0xFFFFFFFF
        self._publisher.publish(message)


class Outlets:
    """All of them. Made by `open`."""

    status: Outlet[SystemStatus]
    overview: Outlet[ResourceOverview]
    grants: Outlet[ResourceGrants]
    policy: Outlet[GlobalPolicy]
    degradation: Outlet[Degradation]
    events: Outlet[SystemEvent]
    diagnostics: Outlet[DiagnosticArray]
    conflicts: Publisher[String]
    route: Publisher[String]

    @classmethod
    async def open(cls, node: NodeHandle) -> Outlets:
        """Advertise all."""
        made = cls()
        latched = LATCHED

        async def outlet(
            topic: str, kind: type[MessageT], qos: QosProfile = latched
        ) -> Outlet[MessageT]:
            return Outlet(await node.advertise(f"/{NAMESPACE}/{topic}", kind, qos=qos), node)

        made.status = await outlet("system_status", SystemStatus)
        made.overview = await outlet("resource_overview", ResourceOverview)
        made.grants = await outlet("resource_grants", ResourceGrants)
        made.policy = await outlet("global_policy", GlobalPolicy)
        made.degradation = await outlet("degradation", Degradation)
        made.events = await outlet("system_events", SystemEvent, QosProfile(depth=1000))
        made.conflicts = await node.advertise(f"/{NAMESPACE}/conflict_resolution", String)
        made.route = await node.advertise(f"/{NAMESPACE}/route", String, qos=latched)
        publisher = await node.advertise("/diagnostics", DiagnosticArray, qos=QosProfile(depth=100))
        made.diagnostics = Outlet(publisher, node)
        return made
