"""Listens to topics without caring what they say: counts, rates, who publishes."""

from __future__ import annotations

import asyncio
import contextlib
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from simple_ros.demos.rates import RateMeter
from simple_ros.errors import SimpleRosError
from simple_ros.graph import ChangeKind, GraphChange, GraphSnapshot
from simple_ros.net.master_client import MasterClient
from simple_ros.node import NodeHandle

__all__ = ["TopicObserver", "TopicRow"]


@dataclass(frozen=True, slots=True)
class TopicRow:
    """What is known about a topic."""

    name: str
    msg_type: str
    rate_hz: float
    messages: int
    bytes_per_s: float
    publishers: tuple[str, ...]


class TopicObserver:
    """Listens to topics.

    Args:
        topics: Type by topic.

    Attributes:
        flowing: Set as soon as a message has come on every topic.
        newest: The newest message of each topic, serialised.
    """

    def __init__(self, topics: Mapping[str, str]) -> None:
        self.flowing = asyncio.Event()
        self.newest: dict[str, bytes] = {}
        self._types = dict(topics)
        self._meters = {name: RateMeter() for name in topics}
        self._publishers: dict[str, set[str]] = defaultdict(set)
        self._clock = asyncio.get_running_loop().time

    async def subscribe(self, node: NodeHandle) -> None:
        """Hear all topics through ``node``."""
        for name, msg_type in self._types.items():
            await node.subscribe(name, msg_type, self._hearer(name), raw=True)

    def _hearer(self, name: str) -> Callable[[bytes], None]:
        meter = self._meters[name]

        def hear(payload: bytes) -> None:
            meter.note(self._clock(), len(payload))
            self.newest[name] = payload
            if not self.flowing.is_set() and len(self.newest) == len(self._types):
                self.flowing.set()

        return hear

    async def watch_graph(self, client: MasterClient) -> None:
        """Learn who publishes, until the Master goes away."""
        with contextlib.suppress(SimpleRosError):
            async for event in client.watch_graph():
                self._note(event)

    def _note(self, event: GraphSnapshot | GraphChange) -> None:
        match event:
            case GraphSnapshot(nodes=nodes):
                self._publishers.clear()
                for node in nodes:
                    for key in node.publishes:
                        self._publishers[key.topic].add(node.name)
            case GraphChange(kind=ChangeKind.PUBLISHER_ADDED, node=name, key=key) if key:
                self._publishers[key.topic].add(name)
            case GraphChange(kind=ChangeKind.PUBLISHER_REMOVED, node=name, key=key) if key:
                self._publishers[key.topic].discard(name)

    def rows(self) -> tuple[TopicRow, ...]:
        """What is known about each topic now."""
        now = self._clock()
        return tuple(
            TopicRow(
                name,
                msg_type,
                self._meters[name].rate_hz(now),
                self._meters[name].messages,
                self._meters[name].bytes_per_s(now),
                tuple(sorted(self._publishers[name])),
            )
            for name, msg_type in self._types.items()
        )
