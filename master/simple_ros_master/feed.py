"""The graph as a watcher sees it: a snapshot, then every change, numbered.

Pure. Memory per watcher is bounded: one that is too slow loses its waiting changes and gets a fresh
snapshot, which contains them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable

from simple_ros.graph import GraphChange, GraphService
from simple_ros.rpc import master_pb2 as master
from simple_ros.rpc.convert import change_to_proto, snapshot_to_proto
from simple_ros_master.graph import MessageGraph

__all__ = ["MAX_WAITING", "ChangeLog", "Feed"]

MAX_WAITING = 1000
"""Changes that may wait for one watcher."""


class Feed:
    """What waits for one watcher; made by `ChangeLog.open`."""

    def __init__(self, log: ChangeLog) -> None:
        self._log = log
        self._waiting: deque[master.GraphEvent] = deque()
        self._is_behind = True

    def add(self, event: master.GraphEvent) -> None:
        """A change happened."""
        if self._is_behind:
            return
        self._waiting.append(event)
        if len(self._waiting) > MAX_WAITING:
            self._waiting.clear()
            self._is_behind = True

    def take(self) -> master.GraphEvent | None:
        """The next event for the watcher, or None when it knows everything."""
        if self._is_behind:
            self._is_behind = False
            return self._log.snapshot()
        return self._waiting.popleft() if self._waiting else None


class ChangeLog:
    """Numbers the changes of a graph and hands them to every open feed."""

    def __init__(
        self, graph: MessageGraph, services: Callable[[], Iterable[GraphService]] = tuple
    ) -> None:
        self._graph = graph
        self._services = services
        self._sequence = 0
        self._feeds: set[Feed] = set()

    def open(self) -> Feed:
        """A feed that starts with a snapshot."""
        feed = Feed(self)
        self._feeds.add(feed)
        return feed

    def close(self, feed: Feed) -> None:
        """Forget a feed."""
        self._feeds.discard(feed)

    def add(self, change: GraphChange) -> None:
        """The graph has changed."""
        self._sequence += 1
        if self._feeds:
            event = master.GraphEvent(sequence=self._sequence, change=change_to_proto(change))
            for feed in self._feeds:
                feed.add(event)

    def snapshot(self) -> master.GraphEvent:
        """The graph as it is, numbered like the last change it contains."""
        graph = snapshot_to_proto(self._graph.nodes(), self._services())
        return master.GraphEvent(sequence=self._sequence, snapshot=graph)
