"""The node: one name, one listener, one Master, any number of publishers, subscribers and timers."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import uuid
from collections.abc import Callable
from typing import Any, Self, TypeVar, overload

from google.protobuf.message import DecodeError, Message

from simple_ros import names
from simple_ros.callbacks import CallbackGuard, is_being_cancelled
from simple_ros.errors import HandleClosed, SimpleRosError, TopicTypeMismatch
from simple_ros.events import IncompatibleQos, QosEventCallback, TypeConflict
from simple_ros.msg.registry import MsgFactory
from simple_ros.net.addresses import (
    find_own_ipv4,
    further_addresses,
    is_loopback,
    master_address,
    split_address,
)
from simple_ros.net.feeder import Source
from simple_ros.net.master_client import MasterClient
from simple_ros.net.server import NodeServer
from simple_ros.publisher import Publisher
from simple_ros.qos import DEFAULT, QosProfile, incompatibilities, strictest, weakest
from simple_ros.registration import Registrar
from simple_ros.router import BadMessages, Router
from simple_ros.rpc import master_pb2 as master
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros.rpc.convert import qos_from_proto
from simple_ros.schedule import TimerSchedule
from simple_ros.subscriber import Callback, Subscriber
from simple_ros.timers import Timer, TimerCallback
from simple_ros.wire.framing import DEFAULT_MAX_MESSAGE_BYTES
from simple_ros.wire.session import EndpointKey, EndpointKind, Target

__all__ = ["NodeHandle", "profile_of"]

logger = logging.getLogger(__name__)

MessageT = TypeVar("MessageT", bound=Message)

_FLUSH_S = 0.4
_nodes: dict[str, NodeHandle] = {}


class NodeHandle:
    """A node of the message graph, on the running event loop.

    Use it as ``async with NodeHandle("talker") as node:``, or call `start` and `close`. Several nodes
    may live in one process.

    Args:
        name: Node name; a leading slash means nothing.
        master: ``host:port`` of the Master; None takes ``SIMPLE_ROS_MASTER``, else
            ``localhost:50051``.
        ip: Dotted IPv4 under which peers reach this node; None takes the one that the route to the
            Master uses.
        port: Port to listen on; 0 takes any free one.
        max_message_bytes: Larger incoming messages are counted and dropped.

    Raises:
        InvalidName: The name breaks the rules.
        ConfigError: ``master`` is no address.
    """

    def __init__(
        self,
        name: str,
        *,
        master: str | None = None,
        ip: str | None = None,
        port: int = 0,
        max_message_bytes: int = DEFAULT_MAX_MESSAGE_BYTES,
    ) -> None:
        self.name = names.node_name(name)
        self.master = master_address(master)
        self.ip = ip or ""
        self.failure: SimpleRosError | None = None
        self.instance_id = uuid.uuid4().hex
        self.guard = CallbackGuard(f"node {self.name!r}")
        self.router = Router(self._push_came, self._link_ended)
        self._fixed_ip = ip
        self._further: tuple[str, ...] = ()
        self._wanted_port = port
        self._max_message_bytes = max_message_bytes
        self._server: NodeServer | None = None
        self._registrar: Registrar | None = None
        self._publishers: dict[EndpointKey, list[Publisher[Any]]] = {}
        self._subscribers: dict[EndpointKey, list[Subscriber[Any]]] = {}
        self._timers: set[Timer] = set()
        self._push_links: dict[Source, set[str]] = {}
        self._loop: asyncio.AbstractEventLoop | None = None
        self._ended = asyncio.Event()
        self._closed = False
        self._closing: asyncio.Task[None] | None = None
        self._flush_until: float | None = None
        self._unpushed: set[str] = set()
        self._classes: dict[str, type[Message]] = {}

    # -- life ----------------------------------------------------------------------------------

    async def start(self) -> Self:
        """Listen, then look for the Master in the background.

        Returns at once even if there is no Master yet; what is registered before waits for it.

        Raises:
            AddressInUse: The port is taken.
            HandleClosed: The node was closed.
        """
        if self._closed:
            raise HandleClosed(f"node {self.name!r}")
        if self._registrar is None:
            self._loop = asyncio.get_running_loop()
            await self.refresh_addresses()
            # Never because the way to the Master could not be found: it may be found later.
            local = is_loopback(self._fixed_ip or split_address(self.master)[0])
            hosts = (self.ip,) if local else ("0.0.0.0", "::")
            self._server = NodeServer(self.router, self._max_message_bytes)
            await self._server.start(hosts, self._wanted_port)
            if self.is_closed:
                await self._server.close()
                raise HandleClosed(f"node {self.name!r}")
            _nodes[self.instance_id] = self
            self._registrar = Registrar(self, self.master)
        return self

    @property
    def is_closed(self) -> bool:
        """Whether `close` was called."""
        return self._closed

    async def close(self) -> None:
        """Send what still waits, say goodbye to the Master, end everything; within 1 s."""
        if self._closing is None:
            self._closed = True
            # In a task of its own: a caller that is cancelled, or closed with the node, ends nothing
            # halfway.
            caller = asyncio.current_task()
            self._closing = asyncio.get_running_loop().create_task(self._close(caller))
        await asyncio.shield(self._closing)

    async def _close(self, caller: asyncio.Task[Any] | None) -> None:
        try:
            for timer in list(self._timers):
                timer.close_sparing(caller)
            await self._flush_all()
            if self._registrar is not None:
                await self._registrar.close()
        finally:
            self._abandon(caller)
            if self._server is not None:
                await self._server.close()
            _nodes.pop(self.instance_id, None)
            self._ended.set()

    async def _flush_all(self) -> None:
        publishers = [pub for group in self._publishers.values() for pub in group]
        if publishers:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(self.flush_allowance()):
                    await asyncio.gather(*(publisher.flush() for publisher in publishers))

    def flush_allowance(self) -> float:
        """How long a handle that closes may wait for its messages to leave, in seconds.

        When the program is told to end, all handles together have what otherwise each has.
        """
        loop = asyncio.get_running_loop()
        if not self._closed and not is_being_cancelled():
            return _FLUSH_S
        if self._flush_until is None:
            self._flush_until = loop.time() + _FLUSH_S
        return max(0.0, self._flush_until - loop.time())

    def _abandon(self, caller: asyncio.Task[Any] | None = None) -> None:
        for publishers in self._publishers.values():
            for publisher in publishers:
                publisher.abandon()
        for subscribers in self._subscribers.values():
            for subscriber in subscribers:
                subscriber.abandon(caller)
        for timer in list(self._timers):
            timer.close_sparing(caller)
        self.router.close()

    async def __aenter__(self) -> Self:
        return await self.start()

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def spin(self) -> None:
        """Wait until the node ends.

        Raises:
            NodeNameTaken: A newer node runs under this node's name.
        """
        await self._ended.wait()
        if self.failure is not None:
            raise self.failure

    async def wait_ended(self) -> None:
        """Return when the node has ended, for whatever reason."""
        await self._ended.wait()

    async def wait_for_master(self, timeout: float | None = None) -> None:
        """Return when the Master has answered.

        Raises:
            TimeoutError: Not within ``timeout`` seconds.
        """
        async with asyncio.timeout(timeout):
            await self._live_registrar().wait_for_master()

    @property
    def port(self) -> int:
        """The port the node listens on; 0 before it is started."""
        return self._server.port if self._server is not None else 0

    @property
    def client(self) -> MasterClient:
        """For further calls to the Master."""
        return self._live_registrar().client

    @property
    def dropped_messages(self) -> BadMessages:
        """What arrived and could not be delivered, by cause."""
        return self.router.bad

    def _live_registrar(self) -> Registrar:
        if self.failure is not None:
            raise self.failure
        if self._closed:
            raise HandleClosed(f"node {self.name!r}")
        if self._registrar is None:
            raise RuntimeError(f"node {self.name!r} is not started; use 'async with' or start()")
        return self._registrar

    # -- what users make -----------------------------------------------------------------------

    async def advertise(
        self,
        topic: str,
        message_class: type[MessageT],
        *,
        qos: QosProfile | int = DEFAULT,
        on_event: QosEventCallback | None = None,
    ) -> Publisher[MessageT]:
        """A publisher on a topic; returns when the Master knows it (and waits for a Master).

        Args:
            topic: Topic name; a leading slash means nothing.
            message_class: Class of its messages.
            qos: What is offered; a number is a depth.
            on_event: Called with `DeadlineMissed`, `IncompatibleQos`, `TypeConflict`.

        Raises:
            InvalidName: The name breaks the rules.
            TopicTypeMismatch: The topic has another message type.
            NodeNameTaken: A newer node runs under this node's name.
            HandleClosed: The node is closed.
        """
        registrar = self._live_registrar()
        canonical = names.topic_name(topic)
        profile = profile_of(qos)
        msg_type = _full_name(message_class)
        key = EndpointKey(EndpointKind.PUBLISHER, canonical, msg_type)
        publisher = Publisher(self, canonical, message_class, profile, on_event)
        siblings = self._publishers.setdefault(key, [])
        before = self.qos_of(key)
        if siblings:
            publisher.targets_update(siblings[0].targets)
        siblings.append(publisher)
        try:
            await registrar.register(key)
            self._tell_if_changed(key, before)
        except BaseException:
            publisher.abandon()
            await self.forget_publisher(publisher)
            raise
        return publisher

    @overload
    async def subscribe(
        self,
        topic: str,
        message_type: type[MessageT],
        callback: Callback[MessageT] | None = None,
        *,
        qos: QosProfile | int = DEFAULT,
        on_event: QosEventCallback | None = None,
    ) -> Subscriber[MessageT]: ...

    @overload
    async def subscribe(
        self,
        topic: str,
        message_type: str,
        callback: Callback[Any] | None = None,
        *,
        qos: QosProfile | int = DEFAULT,
        on_event: QosEventCallback | None = None,
        raw: bool = False,
    ) -> Subscriber[Any]: ...

    async def subscribe(
        self,
        topic: str,
        message_type: type[Message] | str,
        callback: Callback[Any] | None = None,
        *,
        qos: QosProfile | int = DEFAULT,
        on_event: QosEventCallback | None = None,
        raw: bool = False,
    ) -> Subscriber[Any]:
        """A subscription to a topic; returns when the Master knows it (and waits for a Master).

        Args:
            topic: Topic name; a leading slash means nothing.
            message_type: Class of its messages, or their full protobuf name.
            callback: Called with each message; plain or a coroutine function. None leaves messages to
                ``async for message in subscriber``. Subscriptions of one node to one topic are given
                the same object: do not change it.
            qos: What is requested; a number is a depth.
            on_event: Called with `DeadlineMissed`, `LivelinessChanged`, `IncompatibleQos`,
                `TypeConflict`.
            raw: With a type name: deliver serialised ``bytes``, without parsing.

        Raises:
            InvalidName: The name breaks the rules.
            UnknownMessageType: No class of that name is known.
            TopicTypeMismatch: The topic has another message type.
            NodeNameTaken: A newer node runs under this node's name.
            HandleClosed: The node is closed.
        """
        return await self._subscribe(topic, message_type, callback, qos, on_event, raw=raw)

    async def subscribe_batches(
        self,
        topic: str,
        message_type: type[Message] | str,
        callback: Callable[[list[Any]], None] | None,
        *,
        qos: QosProfile | int = DEFAULT,
        on_event: QosEventCallback | None = None,
        raw: bool = False,
        room: Callable[[], int] | None = None,
    ) -> Subscriber[Any]:
        """As `subscribe`, with a plain callback that is given a list: all that one read brought.

        ``room`` tells how many messages the callback can take now, if that is limited; the subscription
        is told by `Subscriber.room_made` when it is more again.
        """
        return await self._subscribe(
            topic,
            message_type,
            callback,
            qos,
            on_event,
            raw=raw,
            batches=callback is not None,
            room=room,
        )

    async def _subscribe(
        self,
        topic: str,
        message_type: type[Message] | str,
        callback: Callback[Any] | None,
        qos: QosProfile | int,
        on_event: QosEventCallback | None,
        *,
        raw: bool,
        batches: bool = False,
        room: Callable[[], int] | None = None,
    ) -> Subscriber[Any]:
        registrar = self._live_registrar()
        canonical = names.topic_name(topic)
        profile = profile_of(qos)
        msg_type, parse = _type_and_parser(message_type, raw=raw)
        if not isinstance(message_type, str):
            self._classes[msg_type] = message_type
        key = EndpointKey(EndpointKind.SUBSCRIBER, canonical, msg_type)
        subscriber: Subscriber[Any] = Subscriber(
            self,
            canonical,
            msg_type,
            callback,
            profile,
            on_event,
            wants_bytes=raw,
            takes_batches=batches,
            room_elsewhere=room,
        )
        # Listening comes before registering: messages may arrive before the Master's answer.
        subscriber.route = self.router.add(canonical, msg_type, parse, subscriber)
        before = self.qos_of(key)
        self._subscribers.setdefault(key, []).append(subscriber)
        try:
            await registrar.register(key)
            self._tell_if_changed(key, before)
            subscriber.sources_changed()
            asyncio.get_running_loop().call_soon(subscriber.route.replay, subscriber)
        except BaseException:
            subscriber.abandon()
            await self.forget_subscriber(subscriber)
            raise
        return subscriber

    def create_timer(
        self, period: float, callback: TimerCallback, oneshot: bool = False, *, start: bool = True
    ) -> Timer:
        """A timer that calls ``callback`` every ``period`` seconds, first after one period.

        Args:
            period: Seconds, more than 0.
            callback: Called with a `TimerEvent`; plain or a coroutine function.
            oneshot: Call once per start.
            start: Whether to start at once.

        Raises:
            ConfigError: The period is not a positive number.
            HandleClosed: The node is closed.
        """
        if self._closed:
            raise HandleClosed(f"node {self.name!r}")
        timer = Timer(self, TimerSchedule(period, oneshot=oneshot), callback)
        self._timers.add(timer)
        if start:
            timer.start()
        return timer

    async def forget_publisher(self, publisher: Publisher[Any]) -> None:
        """A publisher was closed (called by it)."""
        key = EndpointKey(EndpointKind.PUBLISHER, publisher.topic, publisher.msg_type)
        await self._forget(self._publishers, key, publisher)

    async def forget_subscriber(self, subscriber: Subscriber[Any]) -> None:
        """A subscription was closed (called by it)."""
        self.router.remove(subscriber.topic, subscriber.msg_type, subscriber)
        key = EndpointKey(EndpointKind.SUBSCRIBER, subscriber.topic, subscriber.msg_type)
        await self._forget(self._subscribers, key, subscriber)

    def _tell_if_changed(self, key: EndpointKey, before: QosProfile | None) -> None:
        """Several handles share a registration: the Master is told what they make of it together."""
        if self._registrar is not None and before not in (None, self.qos_of(key)):
            self._registrar.changed(key)

    async def _forget(
        self, groups: dict[EndpointKey, list[Any]], key: EndpointKey, item: object
    ) -> None:
        group = groups.get(key, [])
        before = self.qos_of(key)
        if item in group:
            group.remove(item)
            if group:
                self._tell_if_changed(key, before)
        if not group and groups.pop(key, None) is not None and self._registrar is not None:
            await self._registrar.unregister(key)

    def forget_timer(self, timer: Timer) -> None:
        """A timer was closed (called by it)."""
        self._timers.discard(timer)

    # -- what peers and the Master say ---------------------------------------------------------

    def local_peer(self, instance_id: str) -> NodeHandle | None:
        """A node of this process on the same event loop."""
        node = _nodes.get(instance_id) if instance_id else None
        return node if node is not None and node._loop is self._loop else None

    def _push_came(self, link: Source, payload: bytes) -> None:
        try:
            update = ros.TopicTargetsUpdate.FromString(payload)
        except DecodeError as error:
            self.router.bad.add("unparsable", "TopicTargetsUpdate", str(error))
            return
        topic = names.canonical(update.topic)
        self._unpushed.discard(topic)
        if self._registrar is not None and self._registrar.is_foreign:
            self._push_links.setdefault(link, set()).add(topic)
        self._apply_targets(
            topic, update.add_targets, update.remove_targets, snapshot=update.snapshot
        )

    def _apply_targets(
        self, topic: str, add: Any, remove: Any = (), *, snapshot: bool = False
    ) -> None:
        removed = [_target(info, topic) for info in remove]
        for key, publishers in self._publishers.items():
            if key.topic != topic:
                continue
            added = [_target(info, topic) for info in add if self._fits(info, key)]
            for publisher in publishers:
                publisher.targets_update(added, removed, snapshot=snapshot)

    def _fits(self, info: ros.NodeInfo, key: EndpointKey) -> bool:
        """Whether a target wants this type, as far as it says (C++ Masters push any type)."""
        endpoint = info.endpoint
        if names.canonical(endpoint.topic) != key.topic or endpoint.msg_type in ("", key.msg_type):
            return True
        mismatch = TopicTypeMismatch(
            key.topic, info.node_name, endpoint.msg_type, key.msg_type, (self.name,)
        )
        self.router.bad.add("type_mismatch", key.topic, str(mismatch))
        return False

    def _link_ended(self, link: Source) -> None:
        for topic in self._push_links.pop(link, ()):
            if self._registrar is not None:
                self._registrar.push_connection_ended(topic)

    # -- what the registrar asks ---------------------------------------------------------------

    async def refresh_addresses(self) -> None:
        """Find out anew how peers reach this node: robots roam."""
        if self._fixed_ip is None:
            self.ip = await find_own_ipv4(self.master)
        self._further = further_addresses(self.ip, self.port)

    def node_info(self) -> ros.NodeInfo:
        """Name, instance and addresses, as they are now."""
        return ros.NodeInfo(
            ip=self.ip,
            port=self.port,
            node_name=self.name,
            instance_id=self.instance_id,
            addresses=self._further,
        )

    def qos_of(self, key: EndpointKey) -> QosProfile | None:
        """What the handles of this node offer or request on a topic, taken together."""
        if key.kind is EndpointKind.PUBLISHER:
            publishers = self._publishers.get(key)
            return weakest([publisher.qos for publisher in publishers]) if publishers else None
        subscribers = self._subscribers.get(key)
        return strictest([subscriber.qos for subscriber in subscribers]) if subscribers else None

    def message_class_of(self, key: EndpointKey) -> type[Message] | None:
        """The class of a registration's messages; None for subscriptions that only want bytes."""
        publishers = self._publishers.get(key)
        if key.kind is EndpointKind.PUBLISHER and publishers:
            return publishers[0].message_class
        return self._classes.get(key.msg_type)

    def master_changed(self) -> None:
        """A Master that knows nothing is about to be told everything."""
        for publishers in self._publishers.values():
            for publisher in publishers:
                publisher.reregistered()

    def master_lost(self) -> None:
        """The Master is gone."""
        for publishers in self._publishers.values():
            for publisher in publishers:
                publisher.master_lost()

    def registering(self, topic: str) -> None:
        """A topic is about to be registered."""
        self._unpushed.add(topic)

    def subscribers_known(self, topic: str, subscribers: list[ros.NodeInfo]) -> None:
        """The Master named a topic's subscribers in its answer; a push that was faster knows more."""
        if topic in self._unpushed:
            self._unpushed.discard(topic)
            self._apply_targets(topic, subscribers)

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
        for groups in (self._publishers, self._subscribers):
            for key, group in groups.items():
                if key.topic == conflict.topic:
                    for handle in group:
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
        for key, group in self._subscribers.items():
            if key.topic == conflict.topic and conflict.subscriber == self.name:
                logger.warning(
                    "IncompatibleQos: node %r publishes %r with less than requested here: %s",
                    conflict.publisher,
                    conflict.topic,
                    "; ".join(map(str, problems)),
                )
                for subscriber in group:
                    subscriber.report(event)

    def failed(self, error: SimpleRosError) -> None:
        """The node is no longer registered, for good."""
        self.failure = error
        self._abandon()
        self._ended.set()

    def __repr__(self) -> str:
        return f"<NodeHandle {self.name} {self.ip}:{self.port}>"


def profile_of(qos: QosProfile | int) -> QosProfile:
    """A profile; a number is a depth."""
    return DEFAULT.replace(depth=qos) if isinstance(qos, int) else qos


def _full_name(message_class: type[Message]) -> str:
    try:
        return str(message_class.DESCRIPTOR.full_name)
    except AttributeError:
        raise TypeError(f"{message_class!r} is not a protobuf message class") from None


def _type_and_parser(
    message_type: type[Message] | str, *, raw: bool
) -> tuple[str, Callable[[Any], Any]]:
    if not isinstance(message_type, str):
        return _full_name(message_type), message_type.FromString
    if raw:
        return message_type, bytes
    message_class = MsgFactory.instance().get_class(message_type)
    return message_type, message_class.FromString


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
