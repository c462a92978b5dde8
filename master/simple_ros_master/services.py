"""Which services there are, and who provides them.

Pure. A service has one provider. A second one is refused as long as the first is there (ROS 1 would let the
newcomer take over unseen, ROS 2 would let both answer). Only nodes that hold a lease can provide, so
that a service ends with its node.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from simple_ros.graph import ChangeKind, GraphChange, TopicKey
from simple_ros.names import canonical
from simple_ros.rpc import services_pb2 as srv

__all__ = ["ServiceTable", "type_text"]


def type_text(info: srv.ServiceInfo) -> str:
    """The type of a service in one word, or its two messages if they are called differently."""
    stem = info.request_type.removesuffix("Request")
    if info.request_type != stem and info.response_type == f"{stem}Response":
        return stem
    return f"{info.request_type} -> {info.response_type}"


class ServiceTable:
    """The services of one Master.

    Args:
        is_leased: Whether a node of that name and instance id holds a lease.
    """

    def __init__(self, is_leased: Callable[[str, str], bool]) -> None:
        self._services: dict[str, srv.ServiceInfo] = {}
        self._is_leased = is_leased

    def register(
        self, request: srv.RegisterServiceRequest
    ) -> tuple[srv.RegisterServiceResponse, list[GraphChange]]:
        """A node provides a service."""
        info = request.service
        info.name = canonical(info.name)
        provider = info.node_info
        node = canonical(provider.node_name)
        if not info.name:
            return srv.RegisterServiceResponse(message="a service needs a name"), []
        if not self._is_leased(node, provider.instance_id):
            return srv.RegisterServiceResponse(message=f"node {node!r} holds no lease"), []
        existing = self._services.get(info.name)
        if existing is not None and existing.node_info.instance_id != provider.instance_id:
            holder = existing.node_info.node_name
            message = f"node {holder!r} provides service {info.name!r} already"
            return srv.RegisterServiceResponse(message=message, existing=existing), []
        kept = srv.ServiceInfo()
        kept.CopyFrom(info)
        self._services[info.name] = kept
        changes = [] if existing is not None else [_change(ChangeKind.SERVICE_ADDED, kept)]
        return srv.RegisterServiceResponse(success=True), changes

    def unregister(
        self, request: srv.UnregisterServiceRequest
    ) -> tuple[srv.UnregisterServiceResponse, list[GraphChange]]:
        """A node no longer provides a service; what another one provides is no matter of it."""
        name = canonical(request.name)
        info = self._services.get(name)
        changes = []
        if info is not None and info.node_info.instance_id == request.node_info.instance_id:
            del self._services[name]
            changes.append(_change(ChangeKind.SERVICE_REMOVED, info))
        return srv.UnregisterServiceResponse(), changes

    def node_removed(self, node: str) -> list[GraphChange]:
        """A node is gone with its services."""
        gone = [
            info for info in self._services.values() if canonical(info.node_info.node_name) == node
        ]
        for info in gone:
            del self._services[info.name]
        return [_change(ChangeKind.SERVICE_REMOVED, info) for info in gone]

    def get(self, request: srv.GetServicesRequest) -> srv.GetServicesResponse:
        """Services whose name contains the filter, by name."""
        wanted = canonical(request.filter)
        found = [self._services[name] for name in sorted(self._services) if wanted in name]
        return srv.GetServicesResponse(services=found)

    def find(self, name: str) -> srv.ServiceInfo | None:
        """One service, or None."""
        return self._services.get(canonical(name))

    def __iter__(self) -> Iterator[srv.ServiceInfo]:
        return iter([self._services[name] for name in sorted(self._services)])

    def types_in_use(self) -> set[str]:
        """Every message type of some service or action."""
        return {
            type_name
            for info in self._services.values()
            for type_name in (
                info.request_type,
                info.response_type,
                info.action.goal_type,
                info.action.result_type,
                info.action.feedback_type,
            )
            if type_name
        }


def _change(kind: ChangeKind, info: srv.ServiceInfo) -> GraphChange:
    node = info.node_info
    key = TopicKey(info.name, type_text(info))
    return GraphChange(kind, canonical(node.node_name), node.ip, node.port, key)
