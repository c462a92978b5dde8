"""A Master without a process or a network, for nodes of the same event loop."""

from __future__ import annotations

import asyncio
import inspect
from collections.abc import AsyncGenerator, Callable, Iterator
from contextlib import aclosing, contextmanager
from typing import Any

from google.protobuf.message import Message

from simple_ros.errors import MasterUnavailable, TypeDefinitionConflict
from simple_ros.msg.definitions import TypeStore
from simple_ros.names import canonical
from simple_ros.net.master_client import ForeignMaster, LeaseStream, MasterClient
from simple_ros.node import local_node
from simple_ros.parameters.tree import ParameterTree
from simple_ros.rpc import master_pb2 as master
from simple_ros.rpc import methods
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros.rpc import services_pb2 as srv
from simple_ros.rpc.methods import Method
from simple_ros.testing.fake_parameters import FakeParameters

__all__ = ["FakeMaster"]


class FakeMaster:
    """Joins publishers and subscribers of one event loop: ``NodeHandle("a", master=fake)``.

    It matches topics and tells publishers who subscribes, lists services, keeps leases and parameters, and answers
    the queries of `MasterClient`. Conflicts of types, names and QoS are the real Master's business: it
    refuses nothing of the kind.

    Attributes:
        address: What its clients call it.
        nodes: Names of the nodes that hold a lease.
        calls: Names of the calls it has answered.
    """

    address = "localhost:0"

    def __init__(self) -> None:
        self.calls: list[str] = []
        self._is_up = True
        self._leases: dict[str, _FakeLease] = {}
        self._publishers: dict[str, dict[str, ros.NodeInfo]] = {}
        self._subscribers: dict[str, dict[str, ros.NodeInfo]] = {}
        self._types = TypeStore()
        self._services: dict[str, srv.ServiceInfo] = {}
        self._news = asyncio.Event()
        self._lives = 0
        self._parameters = self._new_parameters()
        self._back = asyncio.Event()
        self._back.set()

    @property
    def nodes(self) -> tuple[str, ...]:
        """Names of the nodes that hold a lease, sorted."""
        return tuple(sorted(lease.info.node_name for lease in self._leases.values()))

    def publishers_of(self, topic: str) -> tuple[str, ...]:
        """Names of the nodes that publish a topic, sorted."""
        return _names(self._publishers.get(canonical(topic), {}))

    def subscribers_of(self, topic: str) -> tuple[str, ...]:
        """Names of the nodes that subscribe to a topic, sorted."""
        return _names(self._subscribers.get(canonical(topic), {}))

    def connect(self, *, keepalive: bool) -> MasterClient:  # noqa: ARG002
        """A connection to it."""
        return _FakeClient(self)

    @property
    def parameters(self) -> ParameterTree:
        """What nodes and tools have declared and set, to read."""
        return self._parameters.desk.tree

    def _new_parameters(self) -> FakeParameters:
        self._lives += 1
        return FakeParameters(self.address, lambda lease, event: lease.hear(event), self._lease_of)

    def _lease_of(self, info: ros.NodeInfo) -> _FakeLease | None:
        return self._leases.get(info.instance_id)

    # -- faults --------------------------------------------------------------------------------

    def stop(self) -> None:
        """Die and forget everything: calls fail, leases end; nodes look for it until `restart`."""
        self._is_up = False
        self._back.clear()
        self._publishers.clear()
        self._subscribers.clear()
        self._services.clear()
        for lease in list(self._leases.values()):
            lease.lose()
        self._leases.clear()
        self._parameters.end()
        self._parameters = self._new_parameters()

    def restart(self) -> None:
        """Come back, knowing nothing."""
        self._is_up = True
        self._back.set()

    @contextmanager
    def outage(self) -> Iterator[None]:
        """Be away inside the block."""
        self.stop()
        try:
            yield
        finally:
            self.restart()

    # -- what clients ask ----------------------------------------------------------------------

    async def answer(self, method: Method[Any, Any], request: Any) -> Any:
        """One call."""
        await asyncio.sleep(0)
        if not self._is_up:
            raise MasterUnavailable(self.address)
        self.calls.append(method.name)
        if method.name == methods.FIND_SERVICE.name:
            return await self._find_service(request)
        handler = (self._handlers() | self._parameters.handlers()).get(method.name)
        if handler is None:
            raise ForeignMaster(self.address)
        answer = handler(request)
        return await answer if inspect.isawaitable(answer) else answer

    def watch(self, method: Method[Any, Any], request: Any) -> AsyncGenerator[Any, None]:
        """One call with a stream of answers."""
        if not self._is_up:
            raise MasterUnavailable(self.address)
        if method is not methods.WATCH_PARAMETERS:
            raise ForeignMaster(self.address)
        self.calls.append(method.name)
        return self._parameters.watch(request)

    def _handlers(self) -> dict[str, Callable[[Any], Any]]:
        return {
            methods.REGISTER_PUBLISHER.name: self._register_publisher,
            methods.SUBSCRIBE.name: self._subscribe,
            methods.UNREGISTER_PUBLISHER.name: self._unregister_publisher,
            methods.UNSUBSCRIBE.name: self._unsubscribe,
            methods.GET_NODES.name: self._get_nodes,
            methods.GET_TOPICS.name: self._get_topics,
            methods.GET_TOPIC_INFO.name: self._get_topic_info,
            methods.DECLARE_TYPE.name: self._declare_type,
            methods.GET_TYPE.name: self._get_type,
            methods.REGISTER_SERVICE.name: self._register_service,
            methods.UNREGISTER_SERVICE.name: self._unregister_service,
            methods.GET_SERVICES.name: self._get_services,
        }

    def _register_publisher(self, request: Any) -> Any:
        topic = canonical(request.topic_name)
        self._publishers.setdefault(topic, {})[request.node_info.instance_id] = request.node_info
        subscribers = list(self._subscribers.get(topic, {}).values())
        return ros.RegisterPublisherResponse(success=True, subscribers=subscribers)

    def _subscribe(self, request: Any) -> Any:
        topic = canonical(request.topic_name)
        self._subscribers.setdefault(topic, {})[request.node_info.instance_id] = request.node_info
        self._push(topic, add=[request.node_info])
        return ros.SubscribeResponse(success=True)

    def _unregister_publisher(self, request: Any) -> Any:
        self._publishers.get(canonical(request.topic_name), {}).pop(
            request.node_info.instance_id, None
        )
        return ros.UnregisterPublisherResponse(success=True)

    def _unsubscribe(self, request: Any) -> Any:
        topic = canonical(request.topic_name)
        gone = self._subscribers.get(topic, {}).pop(request.node_info.instance_id, None)
        if gone is not None:
            self._push(topic, remove=[gone])
        return ros.UnsubscribeResponse(success=True)

    def _get_nodes(self, request: Any) -> Any:
        found = [lease.info for lease in self._leases.values()]
        nodes = [info for info in found if request.filter in info.node_name]
        return ros.GetNodesResponse(success=True, nodes=nodes)

    def _get_topics(self, request: Any) -> Any:
        both = (*self._publishers.items(), *self._subscribers.items())
        types = {topic: info.endpoint.msg_type for topic, users in both for info in users.values()}
        topics = [
            ros.TopicInfo(topic_name=topic, msg_type=types[topic])
            for topic in sorted(types)
            if request.filter in topic
        ]
        return ros.GetTopicsResponse(success=True, topics=topics)

    def _get_topic_info(self, request: Any) -> Any:
        topic = canonical(request.topic_name)
        publishers = list(self._publishers.get(topic, {}).values())
        subscribers = list(self._subscribers.get(topic, {}).values())
        kinds = [info.endpoint.msg_type for info in (*publishers, *subscribers)]
        return ros.GetTopicInfoResponse(
            success=True,
            topic_name=topic,
            msg_type=kinds[0] if kinds else "",
            publishers=publishers,
            subscribers=subscribers,
        )

    def _declare_type(self, request: Any) -> Any:
        try:
            self._types.add(request.type_name, request.files)
        except TypeDefinitionConflict as conflict:
            return master.DeclareTypeResponse(
                conflicting_type=conflict.type_name, difference=conflict.difference
            )
        return master.DeclareTypeResponse(success=True)

    def _get_type(self, request: Any) -> Any:
        files = self._types.get(request.type_name)
        return master.GetTypeResponse(known=files is not None, files=files)

    def _register_service(self, request: Any) -> Any:
        self._services[canonical(request.service.name)] = request.service
        self._news.set()
        return srv.RegisterServiceResponse(success=True)

    def _unregister_service(self, request: Any) -> Any:
        self._services.pop(canonical(request.name), None)
        return srv.UnregisterServiceResponse()

    def _get_services(self, request: Any) -> Any:
        names = [name for name in sorted(self._services) if request.filter in name]
        return srv.GetServicesResponse(services=[self._services[name] for name in names])

    async def _find_service(self, request: Any) -> Any:
        while (found := self._services.get(canonical(request.name))) is None and request.wait:
            self._news.clear()
            await self._news.wait()
        return srv.FindServiceResponse(found=found is not None, service=found)

    def _push(self, topic: str, add: Any = (), remove: Any = ()) -> None:
        update = ros.TopicTargetsUpdate(topic=topic, add_targets=add, remove_targets=remove)
        for instance_id in self._publishers.get(topic, {}):
            node = local_node(instance_id)
            if node is not None:
                node.endpoints.take_update(update)

    # -- leases --------------------------------------------------------------------------------

    async def granted(self, lease: _FakeLease) -> None:
        """A lease is asked for; waits until the Master is up."""
        await self._back.wait()
        self._leases[lease.info.instance_id] = lease
        lease.master_id = f"fake {self._lives}"

    def answered(self, lease: _FakeLease, request: master.LeaseRequest) -> None:
        """A node that was asked says something."""
        self._parameters.desk.answered(lease, request.parameter_answer)

    def left(self, lease: _FakeLease) -> None:
        """A node said goodbye, or dropped its lease."""
        if self._leases.pop(lease.info.instance_id, None) is not lease:
            return
        self._parameters.desk.lease_ended(lease)
        for users in self._publishers.values():
            users.pop(lease.info.instance_id, None)
        instance_id = lease.info.instance_id
        self._services = {
            name: info
            for name, info in self._services.items()
            if info.node_info.instance_id != instance_id
        }
        for topic, users in self._subscribers.items():
            gone = users.pop(lease.info.instance_id, None)
            if gone is not None:
                self._push(topic, remove=[gone])


class _FakeLease(LeaseStream):
    def __init__(self, fake: FakeMaster) -> None:
        self.info = ros.NodeInfo()
        self.master_id = ""
        self._fake = fake
        self._events: asyncio.Queue[master.LeaseEvent | None] = asyncio.Queue()

    async def open(self, node_info: ros.NodeInfo) -> master.LeaseGranted:
        self.info = node_info
        await self._fake.granted(self)
        return master.LeaseGranted(master_id=self.master_id)

    async def next_event(self) -> master.LeaseEvent | None:
        return await self._events.get()

    async def say(self, request: master.LeaseRequest) -> None:
        if request.HasField("parameter_answer"):
            self._fake.answered(self, request)

    def hear(self, event: master.LeaseEvent) -> None:
        self._events.put_nowait(event)

    def lose(self) -> None:
        self._events.put_nowait(None)

    async def leave(self) -> None:
        self._fake.left(self)
        self.lose()

    def cancel(self) -> None:
        self._fake.left(self)
        self.lose()


class _FakeClient(MasterClient):
    """A `MasterClient` with no channel."""

    def __init__(self, fake: FakeMaster) -> None:
        self.address = fake.address
        self._fake = fake

    async def close(self) -> None:
        pass

    async def call(
        self,
        method: Method[Any, Any],
        request: Message,
        timeout: float | None = None,  # noqa: ARG002
    ) -> Any:
        return await self._fake.answer(method, request)

    async def stream(self, method: Method[Any, Any], request: Message) -> AsyncGenerator[Any, None]:
        async with aclosing(self._fake.watch(method, request)) as events:
            async for event in events:
                yield event

    def lease(self) -> LeaseStream:
        return _FakeLease(self._fake)


def _names(users: dict[str, ros.NodeInfo]) -> tuple[str, ...]:
    return tuple(sorted(info.node_name for info in users.values()))
