"""The node: one name, one listener, one Master, any number of publishers, subscribers and timers."""

from __future__ import annotations

import asyncio
import functools
import logging
from collections.abc import Callable
from typing import Any, Self, TypeVar, overload

from google.protobuf.message import DecodeError, Message

from simple_ros.arguments import Arguments, process_arguments
from simple_ros.callbacks import CallbackGuard, is_being_cancelled
from simple_ros.clock import Clock
from simple_ros.codecs import codec_of
from simple_ros.endpoints import Endpoints
from simple_ros.errors import HandleClosed, SimpleRosError
from simple_ros.events import QosEventCallback
from simple_ros.identity import Identity
from simple_ros.msg.registry import MsgFactory
from simple_ros.net import busy
from simple_ros.net.feeder import Source
from simple_ros.net.master_client import ForeignMaster, MasterClient, MasterConnector, MasterDouble
from simple_ros.net.server import NodeServer
from simple_ros.net.transport import TCP, Transport, TransportChoice, chosen_transports
from simple_ros.node_actions import ActionMethods
from simple_ros.node_services import ServiceMethods
from simple_ros.parameters.face import ParameterFace
from simple_ros.parameters.local import NodeParameters
from simple_ros.publisher import Publisher
from simple_ros.qos import DEFAULT, QosProfile
from simple_ros.registration import Registrar
from simple_ros.router import BadMessages, Router
from simple_ros.rpc import master_pb2
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros.schedule import TimerSchedule
from simple_ros.subscriber import Callback, Subscriber
from simple_ros.tasks import quietly
from simple_ros.timers import Timer, TimerCallback
from simple_ros.wire.framing import DEFAULT_MAX_MESSAGE_BYTES, TARGETS_UPDATE_TYPE
from simple_ros.wire.session import EndpointKey, EndpointKind

__all__ = ["NodeHandle", "local_node", "profile_of"]

logger = logging.getLogger(__name__)

MessageT = TypeVar("MessageT")

SHUTDOWN_TYPE = master_pb2.Shutdown.DESCRIPTOR.full_name
_FLUSH_S = 0.4
_nodes: dict[str, NodeHandle] = {}


class NodeHandle(ActionMethods, ServiceMethods, ParameterFace):
    """A node of the message graph, on the running event loop.

    Use it as ``async with NodeHandle("talker") as node:``, or call `start` and `close`. Several nodes
    may live in one process.

    Args:
        name: Node name; without a leading slash it is in the namespace.
        master: ``host:port`` of the Master; None takes ``SIMPLE_ROS_MASTER``, else
            ``localhost:50051``. In tests also a `simple_ros.testing.FakeMaster`.
        ip: Dotted IPv4 under which peers reach this node; None takes the one that the route to the
            Master uses.
        port: Port to listen on; 0 takes any free one.
        max_message_bytes: Larger incoming messages are counted and dropped.
        transports: How messages may travel, most wanted first: names or `Transport` objects; None
            takes ``SIMPLE_ROS_TRANSPORTS``, else ``("local", "shm", "unix", "tcp")``.
        busy_poll: Keep the event loop awake while the node is open: messages are noticed earlier, and a
            core is used whole. None takes ``SIMPLE_ROS_BUSY_POLL``, else False.
        namespace: Where its relative names are; ``__ns:=`` replaces it.
        arguments: Name, namespace, remaps and parameters from outside; None takes those of the
            process, from ``SIMPLE_ROS_ARGS`` and the command line.

    Raises:
        InvalidName: The name breaks the rules.
        BadArgument: A word of the command line makes no sense.
        BadParameterText: A file of parameters is wrong.
        ConfigError: ``master`` is no address, or there is no such transport.
    """

    def __init__(
        self,
        name: str,
        *,
        master: str | MasterDouble | None = None,
        ip: str | None = None,
        port: int = 0,
        max_message_bytes: int = DEFAULT_MAX_MESSAGE_BYTES,
        transports: TransportChoice = None,
        busy_poll: bool | None = None,
        namespace: str = "",
        arguments: Arguments | None = None,
    ) -> None:
        told = (process_arguments() if arguments is None else arguments).of(name, namespace)
        self._scope = told.scope
        name = told.scope.node
        if isinstance(master, str | None):
            self.identity = Identity(name, master, ip)
            self._connect: MasterConnector = functools.partial(MasterClient, self.identity.master)
        else:
            self.identity = Identity(name, master.address, ip)
            self._connect = master.connect
        self.name = self.identity.name
        self.failure: SimpleRosError | None = None
        self.transports = chosen_transports(transports)
        self.guard = CallbackGuard(f"node {self.name!r}")
        self.router = Router(
            {
                TARGETS_UPDATE_TYPE: self._push_came,
                SHUTDOWN_TYPE: self._shutdown_came,
            },
            self._link_ended,
            lambda link, name, kind: self.lanes.find(link, name, kind),
        )
        self.endpoints = Endpoints(self.name, self.router)
        self._parameters = NodeParameters(
            told.scope,
            told.overrides,
            self.node_info,
            self._reach_master,
            lambda: self._live_registrar().client,
        )
        if told.log_level:
            logging.getLogger().setLevel(told.log_level.upper())
        self._init_services()
        self._init_actions()
        self._wants_busy_poll = busy.is_wanted() if busy_poll is None else busy_poll
        self._busy_poll: busy.BusyPoll | None = None
        self._wanted_port = port
        self._max_message_bytes = max_message_bytes
        self._server: NodeServer | None = None
        self._registrar: Registrar | None = None
        self._timers: set[Timer] = set()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._ended = asyncio.Event()
        self._closed = False
        self._closing: asyncio.Task[None] | None = None
        self._flush_until: float | None = None
        self._asked_to_end: asyncio.Task[None] | None = None
        self._declaring: asyncio.Task[None] | None = None

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
            self._server = await self._started_server()
            if self.is_closed:
                await self._server.close()
                raise HandleClosed(f"node {self.name!r}")
            if self._wants_busy_poll:
                self._busy_poll = busy.BusyPoll.of(self._loop).acquire()
            self.identity.listens_at(self._server)
            _nodes[self.identity.instance_id] = self
            self._registrar = Registrar(
                self.identity, self.endpoints, self._parameters, self._connect, self._failed
            )
            self._start_clock()
        return self

    def _start_clock(self) -> None:
        """With simulated time it follows ``/clock`` from here on; ``~use_sim_time`` switches."""
        clock = Clock.attach(self)
        self.on_parameter_changed("~use_sim_time", lambda on: clock.use_sim_time(on is True))
        told = self._parameters.override("~use_sim_time")
        if told is not None:
            clock.use_sim_time(told is True)
        if told is not None or clock.is_sim:
            declaring = self.declare_parameter(
                "~use_sim_time", clock.is_sim, description="Go by /clock."
            )
            self._declaring = asyncio.get_running_loop().create_task(quietly(declaring))

    async def _started_server(self) -> NodeServer:
        await self.identity.refresh()
        hosts = (self.identity.ip,) if self.identity.is_local else ("0.0.0.0", "::")
        server = NodeServer(self.router, self._max_message_bytes)
        await server.start(hosts, self._wanted_port)
        others = [
            item for item in self.transports if isinstance(item, Transport) and item is not TCP
        ]
        await server.listen_by(others, self.identity.place)
        return server

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
            await self._finish_actions(caller)
            await self.endpoints.flush(self.flush_allowance())
            if self._registrar is not None:
                await self._registrar.close()
        finally:
            self._abandon(caller)
            if self._server is not None:
                await self._server.close()
            if self._busy_poll is not None:
                self._busy_poll.release()
            _nodes.pop(self.identity.instance_id, None)
            self._ended.set()

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
        self._abandon_actions(caller)
        self.endpoints.abandon(caller)
        self._parameters.abandon()
        self.providers.close()
        self.lanes.is_closed = True
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
    def master(self) -> str:
        """``host:port`` of the Master."""
        return self.identity.master

    @property
    def ip(self) -> str:
        """The dotted IPv4 that peers see; empty before it is started."""
        return self.identity.ip

    @property
    def port(self) -> int:
        """The port the node listens on; 0 before it is started."""
        return self.identity.port

    def node_info(self) -> ros.NodeInfo:
        """Name, instance and addresses, as they are now."""
        return self.identity.node_info()

    @property
    def clock(self) -> Clock:
        """What its timers, rates and stamps go by: the computer's time, or simulated time."""
        return Clock.attach(self)

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

    async def _reach_master(self) -> MasterClient:
        registrar = self._live_registrar()
        await registrar.wait_for_master()
        if registrar.is_foreign:
            raise ForeignMaster(self.master)
        return registrar.client

    @property
    def namespace(self) -> str:
        """Canonical namespace, in which relative names are; empty for the outermost."""
        return self._scope.namespace

    def resolve_name(self, name: str, kind: str = "topic") -> str:
        """The full canonical name that a name means in this node, after remapping.

        Args:
            name: ``chatter`` is in the node's namespace, ``/chatter`` is absolute, ``~chatter`` is the
                node's own. Without a namespace the first two are the same.
            kind: What is named, for the error.

        Raises:
            InvalidName: With a caret under the first character that is wrong.
        """
        return self._scope.resolve(name, kind)

    # -- what users make -----------------------------------------------------------------------

    async def advertise(
        self,
        topic: str,
        message_class: type[MessageT],
        *,
        qos: QosProfile | int = DEFAULT,
        on_event: QosEventCallback | None = None,
        transports: TransportChoice = None,
    ) -> Publisher[MessageT]:
        """A publisher on a topic; returns when the Master knows it (and waits for a Master).

        Args:
            topic: Topic name; what it means says `resolve_name`.
            message_class: Class of its messages: a protobuf class, or one that a codec handles.
            qos: What is offered; a number is a depth.
            on_event: Called with `DeadlineMissed`, `IncompatibleQos`, `TypeConflict`.
            transports: How its messages may travel, most wanted first; None takes the node's.

        Raises:
            InvalidName: The name breaks the rules.
            TypeError: Nothing handles the class.
            TopicTypeMismatch: The topic has another message type.
            NodeNameTaken: A newer node runs under this node's name.
            HandleClosed: The node is closed.
        """
        registrar = self._live_registrar()
        canonical = self.resolve_name(topic)
        codec = codec_of(message_class)
        key = EndpointKey(EndpointKind.PUBLISHER, canonical, codec.type_name(message_class))
        publisher: Publisher[MessageT] = Publisher(
            self,
            canonical,
            message_class,
            codec,
            profile_of(qos),
            on_event,
            self.transports if transports is None else chosen_transports(transports),
        )
        for sibling in self.endpoints.of(key)[:1]:
            publisher.targets_update(sibling.targets)
        before = self.endpoints.qos_of(key)
        self.endpoints.add(key, publisher, codec.definition(message_class))
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
        message_type: type[Any] | str,
        callback: Callback[Any] | None = None,
        *,
        qos: QosProfile | int = DEFAULT,
        on_event: QosEventCallback | None = None,
        raw: bool = False,
    ) -> Subscriber[Any]:
        """A subscription to a topic; returns when the Master knows it (and waits for a Master).

        Args:
            topic: Topic name; what it means says `resolve_name`.
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
        message_type: type[Any] | str,
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
        message_type: type[Any] | str,
        callback: Callback[Any] | None,
        qos: QosProfile | int,
        on_event: QosEventCallback | None,
        *,
        raw: bool,
        batches: bool = False,
        room: Callable[[], int] | None = None,
    ) -> Subscriber[Any]:
        registrar = self._live_registrar()
        canonical = self.resolve_name(topic)
        profile = profile_of(qos)
        msg_type, parse, definition = _type_and_parser(message_type, raw=raw)
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
        before = self.endpoints.qos_of(key)
        self.endpoints.add(key, subscriber, definition)
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
        await self._forget(key, publisher)

    async def forget_subscriber(self, subscriber: Subscriber[Any]) -> None:
        """A subscription was closed (called by it)."""
        self.router.remove(subscriber.topic, subscriber.msg_type, subscriber)
        key = EndpointKey(EndpointKind.SUBSCRIBER, subscriber.topic, subscriber.msg_type)
        await self._forget(key, subscriber)

    async def _forget(self, key: EndpointKey, handle: object) -> None:
        before = self.endpoints.qos_of(key)
        was_last = self.endpoints.remove(key, handle)
        if was_last and self._registrar is not None:
            await self._registrar.unregister(key)
        elif self.endpoints.qos_of(key) is not None:
            self._tell_if_changed(key, before)

    def _tell_if_changed(self, key: EndpointKey, before: QosProfile | None) -> None:
        """Several handles share a registration: the Master is told what they make of it together."""
        if self._registrar is not None and before not in (None, self.endpoints.qos_of(key)):
            self._registrar.changed(key)

    def forget_timer(self, timer: Timer) -> None:
        """A timer was closed (called by it)."""
        self._timers.discard(timer)

    # -- what peers and the Master say ---------------------------------------------------------

    def local_peer(self, instance_id: str) -> NodeHandle | None:
        """A node of this process on the same event loop."""
        node = local_node(instance_id)
        return node if node is not None and node._loop is self._loop else None

    def _push_came(self, link: Source, payload: bytes) -> None:
        is_foreign = self._registrar is not None and self._registrar.is_foreign is True
        self.endpoints.push_came(link, payload, ends_matter=is_foreign)

    def _link_ended(self, link: Source) -> None:
        self.lanes.link_ended(link)
        if self._registrar is not None:
            self.endpoints.link_ended(link, self._registrar.push_connection_ended)

    def _shutdown_came(self, link: Source, payload: bytes) -> None:  # noqa: ARG002
        try:
            request = master_pb2.Shutdown.FromString(payload)
        except DecodeError as error:
            self.router.bad.add("unparsable", "Shutdown", str(error))
            return
        if request.instance_id in ("", self.identity.instance_id) and self._closing is None:
            reason = f": {request.reason}" if request.reason else ""
            logger.warning(
                "node %r ends, asked by %s%s", self.name, request.asked_by or "somebody", reason
            )
            self._asked_to_end = asyncio.get_running_loop().create_task(self.close())

    def _failed(self, error: SimpleRosError) -> None:
        """The node is no longer registered, for good."""
        self.failure = error
        self._abandon()
        self._ended.set()

    def __repr__(self) -> str:
        return f"<NodeHandle {self.name} {self.ip}:{self.port}>"


def local_node(instance_id: str) -> NodeHandle | None:
    """The node of this process with that instance id, on whichever event loop."""
    return _nodes.get(instance_id) if instance_id else None


def profile_of(qos: QosProfile | int) -> QosProfile:
    """A profile; a number is a depth."""
    return DEFAULT.replace(depth=qos) if isinstance(qos, int) else qos


def _type_and_parser(
    message_type: type[Any] | str, *, raw: bool
) -> tuple[str, Callable[[Any], Any], type[Message] | None]:
    """The type's name on the wire, what makes messages of bytes, and what describes it."""
    if not isinstance(message_type, str):
        codec = codec_of(message_type)
        name = codec.type_name(message_type)
        return name, codec.decoder(message_type), codec.definition(message_type)
    if raw:
        return message_type, bytes, None
    return message_type, MsgFactory.instance().get_class(message_type).FromString, None
