"""Carries out what the directory decides: pushes, notices, news for watchers, log lines.

Thin shell; everything runs on one event loop, so calls never overlap and need no lock.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from simple_ros.graph import ChangeKind, GraphChange
from simple_ros.msg.definitions import TypeStore
from simple_ros_master.directory import Directory
from simple_ros_master.feed import ChangeLog, Feed
from simple_ros_master.leases import LeaseDesk
from simple_ros_master.peers import Address, CloseLink, Effect, EndLease, Notice, Push, Watch
from simple_ros_master.pushes import PushPool

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
        self._log = ChangeLog(self.directory.graph)
        self._pool = PushPool(self.directory.resync, self._address_dead)
        self._watchers: set[asyncio.Event] = set()
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
        self._log.add(change)
        for news in self._watchers:
            news.set()
        address = Address(change.ip, change.port)
        if change.kind in _NODE_NEWS:
            logger.info(_NODE_NEWS[change.kind], change.node, address)
        else:
            logger.debug("%s: node %r, %s", change.kind.value, change.node, change.key)

    def _address_dead(self, address: Address) -> None:
        logger.debug("nobody listens at %s", address)
        self.apply(self.directory.address_dead(address))
