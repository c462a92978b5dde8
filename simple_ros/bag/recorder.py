"""Records topics into files: an ordinary node with subscriptions to bytes."""

from __future__ import annotations

import asyncio
import logging
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from simple_ros.bag.channel_qos import metadata_of
from simple_ros.bag.plan import LatchedHistory, TopicSelection
from simple_ros.bag.recent import RecentMessages
from simple_ros.bag.series import BagSeries, RecordedTopic, SeriesOptions
from simple_ros.bag.topics import published_topics
from simple_ros.bag.writing_thread import WritingThread
from simple_ros.errors import (
    MasterUnavailable,
    RegistrationRefused,
    TopicTypeMismatch,
    UnknownMessageType,
)
from simple_ros.events import LivelinessChanged, QosEvent
from simple_ros.graph import TopicKey
from simple_ros.msg.definitions import definition_of
from simple_ros.names import canonical
from simple_ros.net.master_client import TopicNotFound
from simple_ros.node import NodeHandle
from simple_ros.qos import Durability, QosProfile, Reliability, weakest
from simple_ros.rpc.convert import qos_from_proto
from simple_ros.subscriber import Subscriber

__all__ = ["DEFAULT_CACHE_BYTES", "Recorder", "RecordingSummary"]

logger = logging.getLogger(__name__)

DEFAULT_CACHE_BYTES = 100 * 1024 * 1024
_LINGER_S = 0.05  # for what is on its way
_UNDEMANDING = QosProfile(reliability=Reliability.BEST_EFFORT)


@dataclass(frozen=True)
class RecordingSummary:
    """What was recorded.

    Attributes:
        files: The files that are there.
        messages: Messages written.
        size_bytes: Bytes written.
        drops: Messages that came and were not written, by topic.
        failure: Why the recording ended before it was told to, if it did.
    """

    files: tuple[Path, ...]
    messages: int
    size_bytes: int
    drops: dict[str, int]
    failure: Exception | None


class Recorder:
    """Records the topics of a selection until it is stopped.

    Topics are recorded from the moment they are published, those that begin later, too. Use it as
    ``async with Recorder(node, selection, options) as recorder:`` and `wait` or do something else.

    Args:
        node: A started node, which subscribes.
        selection: Which topics.
        options: Where and how.
        max_cache_bytes: How much may wait to be written; what does not fit is counted and given up.
        clock: Gives the time of messages that arrive now, in ns since 1970.
        paused: Whether to begin paused.
        snapshot: Write nothing but the last ``max_cache_bytes`` of messages, when `take_snapshot` is
            called.
        on_topic: Called with each topic when its recording begins.
        on_file: Called with the name of each file.

    Raises:
        BagExists: There is such a file.
        DiskFull: There is no room for it.
    """

    def __init__(
        self,
        node: NodeHandle,
        selection: TopicSelection,
        options: SeriesOptions,
        *,
        max_cache_bytes: int = DEFAULT_CACHE_BYTES,
        clock: Callable[[], int] = time.time_ns,
        paused: bool = False,
        snapshot: bool = False,
        on_topic: Callable[[RecordedTopic], None] = lambda _: None,
        on_file: Callable[[Path], None] = lambda _: None,
    ) -> None:
        self.is_paused = paused
        self._stopped = False
        self._recent = RecentMessages(max_cache_bytes) if snapshot else None
        self._node = node
        self._selection = selection
        self._clock = clock
        self._on_topic = on_topic
        self._loop = asyncio.get_running_loop()
        self._failed = asyncio.Event()
        self._series = BagSeries(options, on_file)
        self._thread = WritingThread(
            self._series,
            max_cache_bytes,
            self._nothing_more,
        )
        self._topics: dict[TopicKey, RecordedTopic] = {}
        self._subscribers: dict[TopicKey, Subscriber[bytes]] = {}
        self._live: set[TopicKey] = set()
        self._published: frozenset[TopicKey] = frozenset()
        self._refused: set[TopicKey] = set()
        self._changed = asyncio.Event()
        self._watching = self._loop.create_task(self._watch(), name="bag topics")
        self._following = self._loop.create_task(self._follow(), name="bag subscriptions")

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.stop()

    async def wait(self) -> None:
        """Return when nothing more can be written, or a part of the recorder has failed."""
        failed = asyncio.create_task(self._failed.wait())
        parts = (self._watching, self._following)
        try:
            await asyncio.wait((failed, *parts), return_when=asyncio.FIRST_COMPLETED)
        finally:
            failed.cancel()
        for part in parts:
            if part.done():
                part.result()

    @property
    def topics(self) -> tuple[RecordedTopic, ...]:
        """The topics that are or were recorded."""
        return tuple(self._topics.values())

    @property
    def drops(self) -> dict[str, int]:
        """Messages that came and were not written, by topic."""
        found: Counter[str] = Counter()
        for topic in self._topics.values():
            found[topic.topic] += topic.dropped
        return {topic: count for topic, count in found.items() if count}

    async def stop(self) -> RecordingSummary:
        """Write what waits, complete the file; twice is the same as once.

        Raises:
            DiskFull: There was no room for as much as an empty file.
        """
        for task in (self._watching, self._following):
            task.cancel()
        await asyncio.gather(self._watching, self._following, return_exceptions=True)
        if self._subscribers:
            await asyncio.sleep(_LINGER_S)
        for subscriber in self._subscribers.values():
            subscriber.abandon()
        self._subscribers.clear()
        if not self._stopped:
            self._stopped = True
            # Not interrupted by a second signal, which would leave the file without its end.
            await asyncio.shield(self._loop.run_in_executor(None, self._finish))
        return RecordingSummary(
            tuple(self._series.finished),
            self._series.message_count,
            self._series.size_bytes,
            self.drops,
            self._thread.failure,
        )

    def _nothing_more(self) -> None:
        """Called from the writing thread."""
        self._loop.call_soon_threadsafe(self._failed.set)

    def _finish(self) -> None:
        self._thread.close()
        self._series.finish(self.drops)

    # -- topics --------------------------------------------------------------------------------

    async def _watch(self) -> None:
        async for published in published_topics(self._node.client):
            self._published = frozenset(
                TopicKey(canonical(key.topic), key.msg_type)
                for key in published
                if self._selection.wants(key.topic)
            )
            self._changed.set()

    async def _follow(self) -> None:
        """Subscribe to what is published, and no longer to what is not.

        A subscription that nobody publishes for any more would keep the topic's type from changing.
        """
        while True:
            await self._changed.wait()
            self._changed.clear()
            for key in self._published - self._subscribers.keys():
                await self._begin(key)
            for key in self._subscribers.keys() - self._published - self._live:
                await self._subscribers.pop(key).close()

    async def _begin(self, key: TopicKey) -> None:
        topic = self._topics.get(key)
        if topic is None:
            topic = await self._described(key)

        def came(payloads: list[bytes]) -> None:
            self._came(topic, payloads)

        def event(event: QosEvent) -> None:
            self._event(key, event)

        try:
            self._subscribers[key] = await self._node.subscribe_batches(
                f"/{key.topic}", key.msg_type, came, qos=_UNDEMANDING, on_event=event, raw=True
            )
        except (TopicTypeMismatch, RegistrationRefused) as error:
            if key not in self._refused:
                self._refused.add(key)
                logger.warning("not recorded: %s", error)
            return
        if key not in self._topics:
            self._warn_of_other_types(key)
            self._topics[key] = topic
            self._on_topic(topic)

    def _warn_of_other_types(self, key: TopicKey) -> None:
        others = [known.msg_type for known in self._topics if known.topic == key.topic]
        if others:
            logger.warning(
                "topic %r carries %s now, before it carried %s: both are recorded",
                key.topic,
                key.msg_type,
                " and ".join(others),
            )

    async def _described(self, key: TopicKey) -> RecordedTopic:
        client = self._node.client
        definition = b""
        try:
            message_class = await client.message_class(key.msg_type)
            definition = definition_of(message_class).SerializeToString(deterministic=True)
        except (UnknownMessageType, MasterUnavailable) as error:
            logger.warning(
                "topic %r is recorded without the definition of its type: %s", key.topic, error
            )
        profile = await self._offered(key)
        latched = profile is not None and profile.durability is Durability.TRANSIENT_LOCAL
        return RecordedTopic(
            key.topic,
            key.msg_type,
            definition,
            {} if profile is None else metadata_of(profile),
            LatchedHistory() if latched else None,
        )

    async def _offered(self, key: TopicKey) -> QosProfile | None:
        """What the publishers of a topic offer; None if they do not say (C++ nodes)."""
        try:
            found = await self._node.client.get_topic_info(key.topic)
        except (TopicNotFound, MasterUnavailable):
            return None
        offers = [
            qos_from_proto(node.endpoint.qos)
            for node in found.publishers
            if node.HasField("endpoint") and node.endpoint.HasField("qos")
        ]
        if not offers:
            return None
        merged = weakest(offers)
        if any(offer.durability is Durability.TRANSIENT_LOCAL for offer in offers):
            return merged.replace(durability=Durability.TRANSIENT_LOCAL)
        return merged

    def _event(self, key: TopicKey, event: QosEvent) -> None:
        if isinstance(event, LivelinessChanged):
            if event.alive:
                self._live.add(key)
            else:
                self._live.discard(key)
                self._changed.set()

    # -- messages ------------------------------------------------------------------------------

    def _came(self, topic: RecordedTopic, payloads: list[bytes]) -> None:
        if self.is_paused:
            return
        if self._recent is None:
            self._put(topic, self._clock(), payloads)
        else:
            self._recent.add(topic, self._clock(), payloads)

    def take_snapshot(self) -> int:
        """Write the messages that are kept, and keep them no longer; gives how many there were."""
        if self._recent is None:
            return 0
        batches = self._recent.taken()
        for topic, stamp_ns, payloads in batches:
            self._put(topic, stamp_ns, payloads)
        return sum(len(payloads) for _, _, payloads in batches)

    def _put(self, topic: RecordedTopic, stamp_ns: int, payloads: Sequence[bytes]) -> None:
        if self._thread.put(topic, stamp_ns, payloads):
            topic.received += len(payloads)
        else:
            if not topic.dropped:
                logger.warning(
                    "dropping messages of %r: the disk does not keep up (said once)", topic.topic
                )
            topic.dropped += len(payloads)
