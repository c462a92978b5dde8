"""Who a node is, and under which addresses its peers reach it."""

from __future__ import annotations

import uuid

from simple_ros import names
from simple_ros.net.addresses import (
    find_own_ipv4,
    further_addresses,
    is_loopback,
    master_address,
    split_address,
)
from simple_ros.net.server import NodeServer
from simple_ros.net.transport import Place
from simple_ros.rpc import ros_rpc_pb2 as ros

__all__ = ["Identity"]


class Identity:
    """Name, instance and addresses of one node.

    Args:
        name: Node name.
        master: ``host:port`` of the Master, or None for the default.
        ip: Dotted IPv4 that peers are told; None takes the one that the route to the Master uses.

    Attributes:
        name: Canonical node name.
        instance_id: Which start of it; unique.
        master: ``host:port`` of the Master.
        ip: What peers are told; empty before `refresh`.
    """

    def __init__(self, name: str, master: str | None, ip: str | None) -> None:
        self.name = names.node_name(name)
        self.master = master_address(master)
        self.instance_id = uuid.uuid4().hex
        self.ip = ip or ""
        self._fixed_ip = ip
        self._server: NodeServer | None = None
        self._further: tuple[str, ...] = ()

    @property
    def is_local(self) -> bool:
        """Whether everything this node has to do with is on this host.

        Never because the way to the Master could not be found: it may be found later.
        """
        return is_loopback(self._fixed_ip or split_address(self.master)[0])

    @property
    def place(self) -> Place:
        """Where its transports listen."""
        return Place(self.name, self.instance_id, self.ip, self.is_local)

    @property
    def port(self) -> int:
        """The TCP port the node listens on; 0 before it does."""
        return self._server.port if self._server is not None else 0

    def listens_at(self, server: NodeServer) -> None:
        """The node's listener, once it listens."""
        self._server = server

    async def refresh(self) -> None:
        """Find out anew how peers reach this node: robots roam."""
        if self._fixed_ip is None:
            self.ip = await find_own_ipv4(self.master)
        by_others = self._server.further_addresses if self._server is not None else ()
        self._further = (*further_addresses(self.ip, self.port), *by_others)

    def node_info(self) -> ros.NodeInfo:
        """Everything, as the Master is told."""
        return ros.NodeInfo(
            ip=self.ip,
            port=self.port,
            node_name=self.name,
            instance_id=self.instance_id,
            addresses=self._further,
        )
