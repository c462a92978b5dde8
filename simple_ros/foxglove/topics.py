"""Topics as channels: each is subscribed at its publishers only while some client wants it."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import grpc

from simple_ros.bag.plan import LatchedHistory
from simple_ros.errors import (
    MasterUnavailable,
    RegistrationRefused,
    TopicTypeMismatch,
    UnknownMessageType,
)
from simple_ros.foxglove.client import Client
from simple_ros.foxglove.frames import Level
from simple_ros.foxglove.graph_model import shown
from simple_ros.foxglove.server import FoxgloveServer
from simple_ros.foxglove.shown_topic import ShownTopic
from simple_ros.foxglove.type_book import TypeBook
from simple_ros.net.master_client import TopicNotFound
from simple_ros.node import NodeHandle
from simple_ros.qos import Durability, QosProfile, Reliability
from simple_ros.rpc.convert import qos_from_proto
from simple_ros.subscriber import Subscriber

__all__ = ["Topics"]

logger = logging.getLogger(__name__)

_UNDEMANDING = QosProfile(reliability=Reliability.BEST_EFFORT)
_UNKNOWN_TYPES = "unknown-types"
_HISTORY_MESSAGES = 1000
_HISTORY_BYTES = 16 * 1024 * 1024


@dataclass(eq=False)
class _Followed:
    """A topic that clients see, and its subscription if one of them wants it."""

    shown: ShownTopic
    subscriber: Subscriber[bytes] | None = None
    publishers: frozenset[str] = frozenset()
    history: LatchedHistory | None = None


class Topics:
    """Keeps the channels of a server like the topics of a graph.

    Args:
        node: Subscribes.
        server: Offers.
        types: Knows types.
        clock_ns: When a message came, in ns since 1970.

    Attributes:
        unknown: Topics whose types nobody knows, with those types.
    """

    def __init__(
        self,
        node: NodeHandle,
        server: FoxgloveServer,
        types: TypeBook,
        clock_ns: Callable[[], int],
    ) -> None:
        self.unknown: set[str] = set()
        self._node = node
        self._server = server
        self._types = types
        self._clock_ns = clock_ns
        self._followed: dict[str, _Followed] = {}
        self._by_channel: dict[int, _Followed] = {}
        self._refused: set[str] = set()

    async def sync(self, published: Mapping[str, str]) -> None:
        """Offer just these topics, given with their types.

        A topic whose type is another one now is a new channel; so is one whose derived channel has to
        give way to a topic of the same name.
        """
        gone = [
            topic
            for topic, item in self._followed.items()
            if published.get(topic) != item.shown.msg_type
            or not item.shown.derived_names.isdisjoint(published)
        ]
        for topic in gone:
            await self._withdraw(self._followed.pop(topic))
        self.unknown = set()
        for topic, type_name in published.items():
            if topic not in self._followed:
                await self._offer(topic, type_name, frozenset(published))
        self._tell_unknown()

    async def _offer(self, topic: str, type_name: str, taken: frozenset[str]) -> None:
        if self._server.has_topic(shown(topic)):
            # The bridge's own; apps take one channel per topic only.
            return
        try:
            known = await self._types.find(type_name)
        except (UnknownMessageType, MasterUnavailable, grpc.aio.AioRpcError):
            self.unknown.add(f"{shown(topic)} ({type_name})")
            return
        made = ShownTopic(self._server, topic, type_name, known.definition, taken)
        item = self._followed[topic] = _Followed(made)
        for channel in made.channels:
            self._by_channel[channel] = item

    async def _withdraw(self, item: _Followed) -> None:
        item.shown.withdraw()
        for channel in item.shown.channels:
            del self._by_channel[channel]
        await self._close(item)

    def _tell_unknown(self) -> None:
        if self.unknown:
            names = ", ".join(sorted(self.unknown))
            reason = f"Not shown, as nobody has declared their types: {names}"
            self._server.say_status(Level.WARNING, reason, _UNKNOWN_TYPES)
        else:
            self._server.take_back_status(_UNKNOWN_TYPES)

    # -- subscriptions -------------------------------------------------------------------------

    async def follow_wishes(self, publishers_of: Callable[[str, str], frozenset[str]]) -> None:
        """Subscribe to the topics that clients want, and to no others.

        Args:
            publishers_of: Nodes that publish a topic with a type.
        """
        for item in list(self._followed.values()):
            if not item.shown.is_wanted:
                await self._close(item)
                continue
            publishers = publishers_of(item.shown.topic, item.shown.msg_type)
            if publishers != item.publishers:
                item.publishers = publishers
                await self._look_whether_latched(item)
            if item.subscriber is None:
                item.shown.restart()
                await self._subscribe(item)

    async def _subscribe(self, item: _Followed) -> None:
        topic = item.shown.topic
        try:
            item.subscriber = await self._node.subscribe_batches(
                f"/{topic}",
                item.shown.msg_type,
                partial(self._came, item),
                qos=_UNDEMANDING,
                raw=True,
            )
        except (TopicTypeMismatch, RegistrationRefused) as error:
            if topic not in self._refused:
                self._refused.add(topic)
                logger.warning("not subscribed: %s", error)

    async def _close(self, item: _Followed) -> None:
        subscriber, item.subscriber = item.subscriber, None
        item.history = None
        item.publishers = frozenset()
        if subscriber is not None:
            await subscriber.close()

    async def _look_whether_latched(self, item: _Followed) -> None:
        kept = await self._kept_by_publishers(item.shown.topic)
        if not kept:
            return
        if item.history is None:
            item.history = LatchedHistory(max_bytes=_HISTORY_BYTES)
            item.shown.mark_latched()
        # Fifty publishers of tf_static have one message each, and all of them count.
        item.history.max_messages = max(item.history.max_messages, min(kept, _HISTORY_MESSAGES))

    async def _kept_by_publishers(self, topic: str) -> int:
        """How many messages publishers keep for late joiners, all together (C++ nodes do not say)."""
        try:
            found = await self._node.client.get_topic_info(topic)
        except (TopicNotFound, MasterUnavailable, grpc.aio.AioRpcError):
            return 0
        profiles = [
            qos_from_proto(node.endpoint.qos)
            for node in found.publishers
            if node.HasField("endpoint") and node.endpoint.HasField("qos")
        ]
        return sum(
            profile.depth
            for profile in profiles
            if profile.durability is Durability.TRANSIENT_LOCAL
        )

    # -- messages ------------------------------------------------------------------------------

    def _came(self, item: _Followed, payloads: list[bytes]) -> None:
        stamp = self._clock_ns()
        item.shown.publish(stamp, payloads)
        if item.history is not None:
            for payload in payloads:
                item.history.add(payload, stamp)

    def replay(self, client: Client, channel: int) -> None:
        """Give a client that just subscribed what a latched topic has said."""
        item = self._by_channel.get(channel)
        if item is not None and item.history is not None:
            item.shown.publish_to(client, channel, item.history.messages())
