"""The Master's parameters: the tree with its leases, watchers and file.

Thin shell: what a call means is decided in `simple_ros.parameters`.
"""

from __future__ import annotations

from typing import Any

from simple_ros.names import canonical
from simple_ros.parameters.desk import ParameterDesk
from simple_ros.parameters.tree import ParameterTree
from simple_ros.rpc import master_pb2 as master
from simple_ros.rpc import parameters_pb2 as par
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros_master.parameter_store import ParameterStore
from simple_ros_master.switchboard import Switchboard

__all__ = ["MasterParameters"]


class MasterParameters:
    """One Master's parameters.

    Args:
        board: Whose leases declare parameters.
        store: The file in which they outlive the Master, if any.

    Attributes:
        desk: Answers the calls.
    """

    def __init__(self, board: Switchboard, store: ParameterStore | None = None) -> None:
        self.desk = ParameterDesk(board.desk.notice)
        self._directory = board.directory
        self._store = store
        self._stopped = False
        if store is not None:
            self.desk.load(store.values)
            self.desk.on_changed = store.changed

    @property
    def tree(self) -> ParameterTree:
        """To read."""
        return self.desk.tree

    def start(self) -> None:
        """Keep the file up to date from now on."""
        if self._store is not None:
            self._store.start(self.tree.kept)

    async def stop(self) -> None:
        """Let nodes go without a word: that a Master ends takes no parameters away."""
        self._stopped = True
        if self._store is not None:
            await self._store.stop()

    def declare(self, request: par.DeclareParametersRequest) -> par.DeclareParametersResponse:
        """A node declares parameters."""
        return self.desk.declare(request, self._lease_of(request.node_info))

    def _lease_of(self, info: ros.NodeInfo) -> int | None:
        peer = self._directory.peers.get(canonical(info.node_name))
        same = peer is not None and peer.instance_id == info.instance_id
        return peer.lease if peer is not None and same else None

    def heard(self, lease: int, request: master.LeaseRequest) -> None:
        """A node says something on its lease."""
        if request.HasField("parameter_answer"):
            self.desk.answered(lease, request.parameter_answer)

    def lease_ended(self, lease: int) -> None:
        """A node is gone."""
        if not self._stopped:
            self.desk.lease_ended(lease)

    async def watch(self, request: par.WatchParametersRequest | None, context: Any) -> None:
        """Tell a watcher, until it goes."""
        with self.desk.watching(request.prefix if request is not None else "") as (feed, news):
            while True:
                news.clear()
                while (event := feed.take()) is not None:
                    await context.write(event)
                await news.wait()
