"""What the blocking NodeHandle is made of."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, overload

from simple_ros.blocking.clock import BlockingClock
from simple_ros.blocking.node_actions import ActionMethods
from simple_ros.blocking.node_services import ServiceMethods
from simple_ros.blocking.parameters import ParameterMethods
from simple_ros.blocking.publisher import Publisher
from simple_ros.blocking.subscriber import Subscriber
from simple_ros.blocking.timer import Timer
from simple_ros.events import QosEventCallback
from simple_ros.executor import Executor
from simple_ros.message_queue import DEFAULT_GROUP, CallbackGroup, Token
from simple_ros.net.loop import BackgroundLoop
from simple_ros.net.master_client import MasterClient
from simple_ros.net.transport import TransportChoice
from simple_ros.node import NodeHandle as AsyncNodeHandle
from simple_ros.node import profile_of
from simple_ros.qos import DEFAULT, QosProfile
from simple_ros.schedule import TimerEvent, TimerSchedule

__all__ = ["BlockingNode"]

MessageT = TypeVar("MessageT")


class BlockingNode(ActionMethods, ServiceMethods, ParameterMethods):
    """A node on the background loop, whose callbacks run where an executor spins.

    What `simple_ros.system_manager.NodeHandle` is made of.
    """

    def __init__(self, loop: BackgroundLoop, executor: Executor, node: AsyncNodeHandle) -> None:
        self._loop = loop
        self._executor = executor
        self._node = node
        self._timers: set[Timer] = set()

    @property
    def name(self) -> str:
        """Canonical node name."""
        return self._node.name

    @property
    def master(self) -> str:
        """``host:port`` of the Master."""
        return self._node.master

    @property
    def ip(self) -> str:
        """The dotted IPv4 that peers see."""
        return self._node.ip

    @property
    def port(self) -> int:
        """The port the node listens on."""
        return self._node.port

    def wait_for_master(self, timeout: float | None = None) -> None:
        """Return when the Master has answered.

        Raises:
            TimeoutError: Not within ``timeout`` seconds.
        """
        self._loop.run(self._node.wait_for_master(timeout))

    @property
    def clock(self) -> BlockingClock:
        """What its timers, rates and stamps go by: the computer's time, or simulated time."""
        return BlockingClock.attach(self._loop, self._node)

    @property
    def client(self) -> MasterClient:
        """The connection to the Master, whose calls are coroutines of the background loop."""
        return self._node.client

    @property
    def namespace(self) -> str:
        """Canonical namespace, in which relative names are; empty for the outermost."""
        return self._node.namespace

    def resolve_name(self, name: str, kind: str = "topic") -> str:
        """The full canonical name that a name means in this node; see `aio.NodeHandle.resolve_name`."""
        return self._node.resolve_name(name, kind)

    def advertise(
        self,
        topic: str,
        message_class: type[MessageT],
        *,
        qos: QosProfile | int = DEFAULT,
        on_event: QosEventCallback | None = None,
        transports: TransportChoice = None,
    ) -> Publisher[MessageT]:
        """A publisher on a topic; see `simple_ros.aio.NodeHandle.advertise`."""
        publisher = self._loop.run(
            self._node.advertise(
                topic,
                message_class,
                qos=qos,
                on_event=self._handed(on_event),
                transports=transports,
            )
        )
        return Publisher(self._loop, publisher)

    @overload
    def subscribe(
        self,
        topic: str,
        message_type: type[MessageT],
        callback: Callable[[MessageT], object] | None = None,
        *,
        qos: QosProfile | int = DEFAULT,
        on_event: QosEventCallback | None = None,
        group: CallbackGroup = DEFAULT_GROUP,
    ) -> Subscriber[MessageT]: ...

    @overload
    def subscribe(
        self,
        topic: str,
        message_type: str,
        callback: Callable[[Any], object] | None = None,
        *,
        qos: QosProfile | int = DEFAULT,
        on_event: QosEventCallback | None = None,
        raw: bool = False,
        group: CallbackGroup = DEFAULT_GROUP,
    ) -> Subscriber[Any]: ...

    def subscribe(
        self,
        topic: str,
        message_type: type[Any] | str,
        callback: Callable[[Any], object] | None = None,
        *,
        qos: QosProfile | int = DEFAULT,
        on_event: QosEventCallback | None = None,
        raw: bool = False,
        group: CallbackGroup = DEFAULT_GROUP,
    ) -> Subscriber[Any]:
        """A subscription to a topic; see `simple_ros.aio.NodeHandle.subscribe`.

        Args:
            topic: Topic name.
            message_type: Class of its messages, or their full name.
            callback: Called in a thread that spins. None leaves messages to
                `Subscriber.receive` and ``for message in subscriber``.
            qos: What is requested; a number is a depth.
            on_event: Called in a thread that spins.
            raw: With a type name: ``bytes``, not parsed.
            group: What the callback may run at the same time with, if several threads spin.
        """
        queue = self._executor.queue
        token = None
        deliver: Callable[[list[Any]], None] | None = None
        room: Callable[[], int] | None = None
        if callback is not None:
            token = queue.add_subscriber(
                self.resolve_name(topic), callback, depth=profile_of(qos).depth, group=group
            )
            deliver = _delivery(queue.deliver, token)
            if profile_of(qos).overflow == "block":
                room = token.room
        subscriber: Subscriber[Any] = Subscriber(self._loop, self._executor, token)
        try:
            subscriber.attach(
                self._loop.run(
                    self._node.subscribe_batches(
                        topic,
                        message_type,
                        deliver,
                        qos=qos,
                        on_event=self._handed(on_event),
                        raw=raw,
                        room=room,
                    )
                )
            )
            if token is not None and room is not None:
                token.on_room = subscriber.tell_room
        except BaseException:
            if token is not None:
                queue.remove_subscriber(token)
            raise
        return subscriber

    def create_timer(
        self,
        period: float,
        callback: Callable[[TimerEvent], object],
        oneshot: bool = False,
        *,
        start: bool = True,
        group: CallbackGroup = DEFAULT_GROUP,
    ) -> Timer:
        """A timer that calls ``callback`` every ``period`` seconds, first after one period."""
        schedule = TimerSchedule(period, oneshot=oneshot)
        timer = Timer(self._executor, schedule, callback, group, self.clock.clock)
        self._timers.add(timer)
        if start:
            timer.start()
        return timer

    def _handed(self, on_event: QosEventCallback | None) -> QosEventCallback | None:
        """The same callback, called in a thread that spins."""
        if on_event is None:
            return None
        return lambda event: self._executor.call_soon(lambda: on_event(event))

    def close(self) -> None:
        """Send what still waits, say goodbye to the Master, end everything."""
        for timer in self._timers:
            timer.close()
        self._loop.run(self._node.close())


def _delivery(
    deliver: Callable[[Token, list[Any]], None], token: Token
) -> Callable[[list[Any]], None]:
    return lambda messages: deliver(token, messages)
