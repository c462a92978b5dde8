"""The parameters of a `FakeMaster`: those of a real one, without its calls over a network."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Callable
from typing import Any

from simple_ros.errors import MasterUnavailable
from simple_ros.parameters.desk import ParameterDesk
from simple_ros.rpc import methods
from simple_ros.rpc import parameters_pb2 as par
from simple_ros.rpc import ros_rpc_pb2 as ros

__all__ = ["FakeParameters"]


class FakeParameters:
    """One life of the parameters of a Master.

    Args:
        address: What clients call the Master.
        send: Says something on a lease.
        lease_of: Gives the lease of a node, or None.
    """

    def __init__(
        self,
        address: str,
        send: Callable[[Any, Any], None],
        lease_of: Callable[[ros.NodeInfo], Any],
    ) -> None:
        self.desk = ParameterDesk(send)
        self._address = address
        self._lease_of = lease_of
        self._news: set[asyncio.Event] = set()
        self._ended = False

    def handlers(self) -> dict[str, Callable[[Any], Any]]:
        """What answers each call, plain or to be awaited."""
        return {
            methods.GET_PARAMETERS.name: self.desk.get,
            methods.LIST_PARAMETERS.name: self.desk.list_names,
            methods.DESCRIBE_PARAMETERS.name: self.desk.describe,
            methods.SET_PARAMETERS.name: self.desk.set,
            methods.DELETE_PARAMETERS.name: self.desk.delete,
            methods.DECLARE_PARAMETERS.name: self._declare,
        }

    def _declare(self, request: par.DeclareParametersRequest) -> Any:
        return self.desk.declare(request, self._lease_of(request.node_info))

    async def watch(
        self, request: par.WatchParametersRequest
    ) -> AsyncGenerator[par.ParameterEvent, None]:
        """Events for a watcher, until the Master ends."""
        with self.desk.watching(request.prefix) as (feed, news):
            self._news.add(news)
            try:
                while not self._ended:
                    news.clear()
                    while (event := feed.take()) is not None:
                        yield event
                    await news.wait()
                raise MasterUnavailable(self._address)
            finally:
                self._news.discard(news)

    def end(self) -> None:
        """The Master is gone."""
        self._ended = True
        for news in self._news:
            news.set()
