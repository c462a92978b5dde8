"""What a node publishes and subscribes, and what the Master says about it."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable, Iterable
from typing import Any, cast

from google.protobuf.message import DecodeError, Message

from simple_ros import names
from simple_ros.errors import TopicTypeMismatch
from simple_ros.events import IncompatibleQos, TypeConflict
from simple_ros.net.feeder import Source
from simple_ros.publisher import Publisher
from simple_ros.qos import QosProfile, incompatibilities, strictest, weakest
from simple_ros.router import Router
from simple_ros.rpc import master_pb2 as master
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros.rpc import services_pb2 as srv
from simple_ros.rpc.convert import qos_from_proto
from simple_ros.service_server import ServiceServer
from simple_ros.subscriber import Subscriber
from simple_ros.wire.session import EndpointKey, EndpointKind, Target

__all__ = ["Endpoints"]

logger = logging.getLogger(__name__)

Endpoint = Publisher[Any] | Subscriber[Any] | ServiceServer[Any, Any]


class Endpoints:
    """The publishers and subscriptions of one node; several on one topic share a registration.

    Args:
        name: Of the node.
        router: Brings the messages, and counts what is wrong with them.
    """

    def __init__(self, name: str, router: Router) -> None:
        self._name = name
        self._router = router
        self._handles: dict[EndpointKey, list[Any]] = {}
        self._definitions: dict[str, type[Message]] = {}
        self._unpushed: set[str] = set()
        self._push_links: dict[Source, set[str]] = {}

    # -- keeping them --------------------------------------------------------------------------

    def add(self, key: EndpointKey, handle: Endpoint, definition: type[Message] | None) -> None:
        """Keep a handle; ``definition`` describes its messages to others."""
        self._handles.setdefault(key, []).append(handle)
        if definition is not None:
            self._definitions[key.msg_type] = definition

    def remove(self, key: EndpointKey, handle: object) -> bool:
        """Forget a handle; True if it was the last of its registration."""
        group = self._handles.get(key)
        if group is None or handle not in group:
            return False
        group.remove(handle)
        if group:
            return False
        del self._handles[key]
        return True

    def of(self, key: EndpointKey) -> tuple[Any, ...]:
        """The handles that share a registration."""
        return tuple(self._handles.get(key, ()))

    @property
    def publishers(self) -> tuple[Publisher[Any], ...]:
        """All of them."""
        return tuple(handle for _, handle in self._all(EndpointKind.PUBLISHER))

    def _all(self, kind: EndpointKind | None = None) -> Iterable[tuple[EndpointKey, Any]]:
        for key, group in list(self._handles.items()):
            if kind in (None, key.kind):
                for handle in list(group):
                    yield key, handle

    def qos_of(self, key: EndpointKey) -> QosProfile | None:
        """What the handles of a registration offer or request, taken together."""
        group = self._handles.get(key)
        if not group or key.kind is EndpointKind.SERVICE:
            return None
        together = weakest if key.kind is EndpointKind.PUBLISHER else strictest
        return together([handle.qos for handle in group])

    def definitions_of(self, key: EndpointKey) -> tuple[type[Message], ...]:
        """The protobuf classes of a registration's messages, as far as they are known."""
        if key.kind is EndpointKind.SERVICE:
            return tuple(self.of(key)[0].definitions) if self.of(key) else ()
        known = self._definitions.get(key.msg_type)
        return () if known is None else (known,)

    def service_info(self, key: EndpointKey, node_info: ros.NodeInfo) -> srv.ServiceInfo:
        """What the Master is told about a service."""
        handles = self.of(key)
        info = handles[0].info() if handles else srv.ServiceInfo(name=key.topic)
        info.node_info.CopyFrom(node_info)
        return info

    def service_named(self, name: str) -> ServiceServer[Any, Any] | None:
        """A service this node provides, or None."""
        for key, handle in self._all(EndpointKind.SERVICE):
            if key.topic == name:
                return cast("ServiceServer[Any, Any]", handle)
        return None

    async def flush(self, allowance_s: float) -> None:
        """Send what still waits, for at most so long."""
        publishers = self.publishers
        if publishers:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(allowance_s):
                    await asyncio.gather(*(publisher.flush() for publisher in publishers))

    def abandon(self, caller: asyncio.Task[Any] | None = None) -> None:
        """End all at once, telling nobody; cancels no task that is the caller."""
        for key, handle in self._all():
            if key.kind is EndpointKind.PUBLISHER:
                handle.abandon()
            else:
                handle.abandon(caller)

    # -- subscribers of its publishers ---------------------------------------------------------

    def push_came(self, link: Source, payload: bytes, *, ends_matter: bool) -> None:
        """A Master pushed an update; ``ends_matter`` if its connection is for this push only."""
        try:
            update = ros.TopicTargetsUpdate.FromString(payload)
        except DecodeError as error:
            self._router.bad.add("unparsable", "TopicTargetsUpdate", str(error))
            return
        if ends_matter:
            self._push_links.setdefault(link, set()).add(names.canonical(update.topic))
        self.take_update(update)

    def take_update(self, update: ros.TopicTargetsUpdate) -> None:
        """The Master says who subscribes to a topic."""
        topic = names.canonical(update.topic)
        self._unpushed.discard(topic)
        self.apply_targets(
            topic, update.add_targets, update.remove_targets, snapshot=update.snapshot
        )

    def link_ended(self, link: Source, push_ended: Callable[[str], None]) -> None:
        """A connection is gone; ``push_ended`` is told the topics it brought pushes about."""
        for topic in self._push_links.pop(link, ()):
            push_ended(topic)

    def registering(self, topic: str) -> None:
        """A topic is about to be registered."""
        self._unpushed.add(topic)

    def subscribers_known(self, topic: str, subscribers: list[ros.NodeInfo]) -> None:
        """The Master named a topic's subscribers in its answer; a push that was faster knows more."""
        if topic in self._unpushed:
            self._unpushed.discard(topic)
            self.apply_targets(topic, subscribers)

    def apply_targets(
        self, topic: str, add: Any, remove: Any = (), *, snapshot: bool = False
    ) -> None:
        """Subscribers of a topic came or went."""
        removed = [_target(info, topic) for info in remove]
        for key, publisher in self._all(EndpointKind.PUBLISHER):
            if key.topic == topic:
                added = [_target(info, topic) for info in add if self._fits(info, key)]
                publisher.targets_update(added, removed, snapshot=snapshot)

    def _fits(self, info: ros.NodeInfo, key: EndpointKey) -> bool:
        """Whether a target wants this type, as far as it says (C++ Masters push any type)."""
        endpoint = info.endpoint
        if names.canonical(endpoint.topic) != key.topic or endpoint.msg_type in ("", key.msg_type):
            return True
        mismatch = TopicTypeMismatch(
            key.topic, info.node_name, endpoint.msg_type, key.msg_type, (self._name,)
        )
        self._router.bad.add("type_mismatch", key.topic, str(mismatch))
        return False

    def master_changed(self) -> None:
        """A Master that knows nothing is about to be told everything."""
        for publisher in self.publishers:
            publisher.reregistered()

    def master_lost(self) -> None:
        """The Master is gone."""
        for publisher in self.publishers:
            publisher.master_lost()

    # -- what the Master notices ---------------------------------------------------------------

    def notice(self, event: master.LeaseEvent) -> None:
        """The Master has something to say."""
        match event.WhichOneof("kind"):
            case "type_conflict":
                self._type_conflict(event.type_conflict)
            case "qos_conflict":
                self._qos_conflict(event.qos_conflict)

    def _type_conflict(self, conflict: master.TypeConflictNotice) -> None:
        error = TopicTypeMismatch(
            conflict.topic,
            conflict.node_name,
            conflict.msg_type,
            conflict.existing_type,
            tuple(conflict.existing_nodes),
        )
        logger.warning("TopicTypeMismatch: %s", error)
        event = TypeConflict(conflict.topic, conflict.node_name, conflict.msg_type)
        for key, handle in self._all():
            if key.topic == conflict.topic and key.kind is not EndpointKind.SERVICE:
                handle.report(event)

    def _qos_conflict(self, conflict: master.QosConflictNotice) -> None:
        """Subscribers are warned here; publishers find out by themselves from the push."""
        offered, requested = qos_from_proto(conflict.offered), qos_from_proto(conflict.requested)
        problems = incompatibilities(offered, requested)
        event = IncompatibleQos(
            conflict.topic,
            conflict.publisher,
            conflict.subscriber,
            tuple(problem.policy for problem in problems),
        )
        for topic in {key.topic for key, _ in self._all(EndpointKind.SUBSCRIBER)}:
            if topic == conflict.topic and conflict.subscriber == self._name:
                logger.warning(
                    "IncompatibleQos: node %r publishes %r with less than requested here: %s",
                    conflict.publisher,
                    conflict.topic,
                    "; ".join(map(str, problems)),
                )
                for key, subscriber in self._all(EndpointKind.SUBSCRIBER):
                    if key.topic == topic:
                        subscriber.report(event)


def _target(info: ros.NodeInfo, topic: str) -> Target:
    endpoint = info.endpoint
    known = info.HasField("endpoint") and names.canonical(endpoint.topic) == topic
    return Target(
        info.ip,
        info.port,
        names.canonical(info.node_name),
        info.instance_id,
        tuple(info.addresses),
        endpoint.topic if known else topic,
        qos_from_proto(endpoint.qos) if known and endpoint.HasField("qos") else None,
    )
