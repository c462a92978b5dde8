"""Which topics are published, as it changes, from Masters of any kind."""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import AsyncIterator

from simple_ros.errors import MasterUnavailable
from simple_ros.graph import ChangeKind, GraphChange, GraphSnapshot, TopicKey
from simple_ros.net.master_client import ForeignMaster, MasterClient

__all__ = ["PublishedTopics", "published_topics"]

logger = logging.getLogger(__name__)

_RETRY_S = 0.5
_POLL_S = 1.0


class PublishedTopics:
    """Counts publishers by topic and type, from what `MasterClient.watch_graph` tells. Pure."""

    def __init__(self) -> None:
        self._counts: Counter[TopicKey] = Counter()

    @property
    def keys(self) -> frozenset[TopicKey]:
        """The topics that somebody publishes."""
        return frozenset(self._counts)

    def take(self, item: GraphSnapshot | GraphChange) -> bool:
        """Take in what the Master said; whether topics came or went."""
        before = self.keys
        if isinstance(item, GraphSnapshot):
            self._counts = Counter(key for node in item.nodes for key in node.publishes)
        elif item.key is not None and item.kind is ChangeKind.PUBLISHER_ADDED:
            self._counts[item.key] += 1
        elif item.key is not None and item.kind is ChangeKind.PUBLISHER_REMOVED:
            self._counts[item.key] -= 1
            self._counts += Counter()  # forgets those with none
        return self.keys != before


async def published_topics(client: MasterClient) -> AsyncIterator[frozenset[TopicKey]]:
    """The topics that somebody publishes: now, and after each change. Waits for a Master that is away.

    A C++ Master, which tells no changes, is asked every second.
    """
    topics = PublishedTopics()
    while True:
        try:
            async for item in client.watch_graph():
                if topics.take(item) or isinstance(item, GraphSnapshot):
                    yield topics.keys
        except ForeignMaster:
            async for keys in _polled(client):
                yield keys
        except MasterUnavailable as error:
            logger.debug("%s", error)
        await asyncio.sleep(_RETRY_S)


async def _polled(client: MasterClient) -> AsyncIterator[frozenset[TopicKey]]:
    before: frozenset[TopicKey] | None = None
    while True:
        try:
            found = await client.get_topics()
        except MasterUnavailable as error:
            logger.debug("%s", error)
            return
        keys = frozenset(TopicKey(topic.topic_name, topic.msg_type) for topic in found)
        if keys != before:
            before = keys
            yield keys
        await asyncio.sleep(_POLL_S)
