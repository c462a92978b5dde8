"""Carries out what the directory decides: pushes, notices, news for watchers, log lines.

Thin shell; everything runs on one event loop, so calls never overlap and need no lock.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from simple_ros.graph import ChangeKind, GraphChange, GraphService
from simple_ros.msg.definitions import TypeStore
from simple_ros.names import canonical
from simple_ros_master.directory import Directory
from simple_ros_master.feed import ChangeLog, Feed
from simple_ros_master.leases import LeaseDesk
from simple_ros_master.peers import Address, CloseLink, Effect, EndLease, Notice, Push, Watch
from simple_ros_master.pushes import PushPool
from simple_ros_master.services import ServiceTable, type_text

__all__ = ["Switchboard"]

logger = logging.getLogger(__name__)

_NODE_NEWS = {
    ChangeKind.NODE_ADDED: "node %r at %s",
    ChangeKind.NODE_REMOVED: "node %r left %s",
}


class Switchboard:
    """One Master's directory with everything that its effects go to."""

    def __init__(self, master_id: str, master_version: str) -> None:
        self.directory = Directory(master_id, master_version)
        self.types = TypeStore()
        self.desk = LeaseDesk()
        self.services = ServiceTable(self._is_leased)
        self._log = ChangeLog(self.directory.graph, self._graph_services)
        self._pool = PushPool(self.directory.resync, self._address_dead)
        self._watchers: set[asyncio.Event] = set()
        self._awaiting_services: set[asyncio.Event] = set()
        self._stopped = False

    async def stop(self) -> None:
        """Carry out nothing from now on: that a Master ends must not part its nodes."""
        self._stopped = True
        await self._pool.stop()

    @contextmanager
    def watching(self) -> Iterator[tuple[Feed, asyncio.Event]]:
        """News of the graph, and a signal that is set whenever there are more."""
        feed, news = self._log.open(), asyncio.Event()
        self._watchers.add(news)
        try:
            yield feed, news
        finally:
            self._watchers.discard(news)
            self._log.close(feed)

    @contextmanager
    def news_of_services(self) -> Iterator[asyncio.Event]:
        """A signal that is set whenever there is a new service."""
        news = asyncio.Event()
        self._awaiting_services.add(news)
        try:
            yield news
        finally:
            self._awaiting_services.discard(news)

    def _is_leased(self, node: str, instance_id: str) -> bool:
        peer = self.directory.peers.get(node)
        return peer is not None and peer.lease is not None and peer.instance_id == instance_id

    def _graph_services(self) -> list[GraphService]:
        return [
            GraphService(info.name, type_text(info), canonical(info.node_info.node_name))
            for info in self.services
        ]

    def types_in_use(self) -> set[str]:
        """Every message type that somebody uses."""
        return self.directory.graph.types_in_use() | self.services.types_in_use()

    def apply(self, effects: Iterable[Effect]) -> None:
        """Carry out effects in order."""
        if self._stopped:
            return
        for effect in effects:
            match effect:
                case Push(address, update):
                    self._pool.push(address, update)
                case Watch(address, on):
                    self._pool.watch(address, on=on)
                case CloseLink(address):
                    self._pool.close(address)
                case Notice(lease, event):
                    self.desk.notice(lease, event)
                case EndLease(lease, error):
                    self.desk.end(lease, error)
                case GraphChange():
                    self._graph_changed(effect)

    def _graph_changed(self, change: GraphChange) -> None:
        if change.kind is ChangeKind.NODE_REMOVED:
            for ended in self.services.node_removed(change.node):
                self._graph_changed(ended)
        self._log.add(change)
        waiting = self._awaiting_services if change.kind is ChangeKind.SERVICE_ADDED else ()
        for news in (*self._watchers, *waiting):
            news.set()
        address = Address(change.ip, change.port)
        if change.kind in _NODE_NEWS:
            logger.info(_NODE_NEWS[change.kind], change.node, address)
        else:
            logger.debug("%s: node %r, %s", change.kind.value, change.node, change.key)

    def _address_dead(self, address: Address) -> None:
        logger.debug("nobody listens at %s", address)
        self.apply(self.directory.address_dead(address))
