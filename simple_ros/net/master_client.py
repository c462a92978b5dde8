"""Calls to a Master, ours or C++ simple_ros's."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncGenerator, AsyncIterator
from types import TracebackType
from typing import Any, Protocol, Self, TypeVar

import grpc
from google.protobuf.message import Message

from simple_ros.errors import (
    MasterUnavailable,
    NodeNameTaken,
    SimpleRosError,
    TypeDefinitionConflict,
)
from simple_ros.graph import GraphChange, GraphSnapshot
from simple_ros.msg.definitions import definition_of, message_class
from simple_ros.msg.registry import MsgFactory
from simple_ros.net.addresses import join_address, master_address
from simple_ros.rpc import master_pb2 as master
from simple_ros.rpc import methods
from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros.rpc.convert import change_from_proto, snapshot_from_proto
from simple_ros.rpc.methods import Method

__all__ = [
    "ForeignMaster",
    "LeaseStream",
    "MasterClient",
    "MasterConnector",
    "MasterDouble",
    "TopicNotFound",
]

Request = TypeVar("Request", bound=Message)
Response = TypeVar("Response", bound=Message)

_OPTIONS: list[tuple[str, Any]] = [
    # Measured: with the default backoff a node is back 3.4 s after its Master, with this 0.15 s.
    ("grpc.initial_reconnect_backoff_ms", 100),
    # This one is how long the handshake may take: a slow link must be able to make it.
    ("grpc.min_reconnect_backoff_ms", 5000),
    ("grpc.max_reconnect_backoff_ms", 500),
    ("grpc.enable_http_proxy", 0),
    ("grpc.client_idle_timeout_ms", 2**31 - 1),
    ("grpc.max_receive_message_length", -1),
    ("grpc.use_local_subchannel_pool", 1),
]
_KEEPALIVE: list[tuple[str, Any]] = [
    ("grpc.keepalive_time_ms", 5000),
    ("grpc.keepalive_timeout_ms", 3000),
    # Without it a silent peer is only cut after a minute, whatever the line above says.
    ("grpc.http2.ping_timeout_ms", 3000),
    ("grpc.http2.max_pings_without_data", 0),
]
DEFAULT_TIMEOUT_S = 5.0


class MasterConnector(Protocol):
    """Makes connections to one Master."""

    def __call__(self, *, keepalive: bool) -> MasterClient:
        """A new connection."""


class MasterDouble(Protocol):
    """What stands in for a Master, without a network."""

    address: str

    def connect(self, *, keepalive: bool) -> MasterClient:
        """A new connection."""


class ForeignMaster(SimpleRosError):
    """The Master offers only the calls of C++ simple_ros."""

    def __init__(self, address: str) -> None:
        self.address = address
        super().__init__(f"the Master at {address} has no such call (C++ simple_ros?)")


class TopicNotFound(SimpleRosError, LookupError):
    """The Master knows no such topic."""

    def __init__(self, topic: str) -> None:
        self.topic = topic
        super().__init__(f"no topic {topic!r}")


class LeaseStream:
    """An open lease: its standing is the node's sign of life."""

    def __init__(self, call: Any) -> None:
        self._call = call
        self._saying = asyncio.Lock()

    async def open(self, node_info: ros.NodeInfo) -> master.LeaseGranted:
        """Ask for the lease; waits for the Master if nobody answers.

        Raises:
            grpc.aio.AioRpcError: The Master went away, or knows no leases.
            NodeNameTaken: This instance was replaced by a newer one.
            ConnectionError: The stream ended with no answer.
        """
        await self._call.write(master.LeaseRequest(open=master.LeaseOpen(node_info=node_info)))
        event = await self.next_event()
        if event is not None and event.WhichOneof("kind") == "name_taken":
            by = event.name_taken.taken_by
            raise NodeNameTaken(node_info.node_name, join_address(by.ip, by.port))
        if event is None or event.WhichOneof("kind") != "granted":
            raise ConnectionError("the Master did not grant a lease")
        return event.granted

    async def next_event(self) -> master.LeaseEvent | None:
        """The next event, or None when the Master ended the lease."""
        event = await self._call.read()
        return event if isinstance(event, master.LeaseEvent) else None

    async def say(self, request: master.LeaseRequest) -> None:
        """Tell the Master something.

        Raises:
            grpc.aio.AioRpcError: The Master went away.
            asyncio.InvalidStateError: The stream has ended.
        """
        async with self._saying:
            await self._call.write(request)

    async def leave(self) -> None:
        """Say goodbye; the Master answers by ending the stream."""
        await self.say(master.LeaseRequest(release=master.LeaseRelease()))
        await self._call.done_writing()

    def cancel(self) -> None:
        """Drop the stream."""
        self._call.cancel()


class MasterClient:
    """All calls of the control plane.

    Args:
        address: ``host:port``; None takes ``SIMPLE_ROS_MASTER`` or ``localhost:50051``.
        keepalive: Probe the connection, so that a vanished host is noticed. C++ Masters cut
            clients that do.

    Raises:
        ConfigError: The address is none.
    """

    def __init__(self, address: str | None = None, *, keepalive: bool = False) -> None:
        self.address = master_address(address)
        options = _OPTIONS + _KEEPALIVE if keepalive else _OPTIONS
        self._channel = grpc.aio.insecure_channel(self.address, options=options)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """End the connection; calls under way fail."""
        await self._channel.close()

    async def call(
        self,
        method: Method[Request, Response],
        request: Request,
        timeout: float | None = DEFAULT_TIMEOUT_S,
    ) -> Response:
        """One unary call.

        Raises:
            MasterUnavailable: Nobody answers, or not within ``timeout`` seconds.
            ForeignMaster: The Master has no such call.
            grpc.aio.AioRpcError: Any other status.
        """
        stub = self._channel.unary_unary(
            method.path,
            request_serializer=method.request.SerializeToString,
            response_deserializer=method.response.FromString,
        )
        try:
            response: Response = await stub(request, timeout=timeout)
        except grpc.aio.AioRpcError as error:
            raise self._translated(error) from None
        except asyncio.CancelledError:
            if _is_cancelled():
                raise
            raise MasterUnavailable(self.address, "connection closed") from None
        return response

    def _translated(self, error: grpc.aio.AioRpcError) -> Exception:
        match error.code():
            case grpc.StatusCode.UNAVAILABLE:
                return MasterUnavailable(self.address)
            case grpc.StatusCode.DEADLINE_EXCEEDED:
                return MasterUnavailable(self.address, "no answer in time")
            case grpc.StatusCode.UNIMPLEMENTED:
                return ForeignMaster(self.address)
            case _:
                return error

    # -- registry queries ----------------------------------------------------------------------

    async def get_nodes(self, filter: str = "") -> list[ros.NodeInfo]:  # noqa: A002
        """Nodes whose name contains ``filter``."""
        response = await self.call(methods.GET_NODES, ros.GetNodesRequest(filter=filter))
        return list(response.nodes)

    async def get_node_info(self, name: str) -> ros.GetNodeInfoResponse | None:
        """One node with its topics, or None if the Master does not know it."""
        request = ros.GetNodeInfoRequest(node_name=name)
        response = await self.call(methods.GET_NODE_INFO, request)
        return response if response.success else None

    async def get_topics(self, filter: str = "") -> list[ros.TopicInfo]:  # noqa: A002
        """Topics whose name contains ``filter``, with their types."""
        response = await self.call(methods.GET_TOPICS, ros.GetTopicsRequest(filter=filter))
        return list(response.topics)

    async def get_topic_info(self, topic: str) -> ros.GetTopicInfoResponse:
        """Type, publishers and subscribers of a topic.

        Raises:
            TopicNotFound: The Master does not know the topic.
        """
        try:
            return await self.call(
                methods.GET_TOPIC_INFO, ros.GetTopicInfoRequest(topic_name=topic)
            )
        except grpc.aio.AioRpcError as error:
            if error.code() is grpc.StatusCode.NOT_FOUND:
                raise TopicNotFound(topic) from None
            raise

    # -- ours ----------------------------------------------------------------------------------

    async def export_graph(self, format: master.GraphFormat.ValueType) -> str:  # noqa: A002
        """The Master's own print-out of its graph.

        Raises:
            ForeignMaster: It is a C++ Master.
        """
        request = master.ExportGraphRequest(format=format)
        return (await self.call(methods.EXPORT_GRAPH, request)).text

    async def declare_type(self, message_class: type[Message]) -> None:
        """Give the Master the definition of a message type, for tools that have never seen it.

        Raises:
            TypeDefinitionConflict: It knows the type with another definition.
            ForeignMaster: It is a C++ Master.
        """
        request = master.DeclareTypeRequest(
            type_name=message_class.DESCRIPTOR.full_name, files=definition_of(message_class)
        )
        answer = await self.call(methods.DECLARE_TYPE, request)
        if not answer.success:
            raise TypeDefinitionConflict(answer.conflicting_type, answer.difference)

    async def message_class(self, type_name: str) -> type[Message]:
        """The class of a message type: as known in this process, else as some node declared it.

        Raises:
            UnknownMessageType: Neither knows it.
        """
        factory = MsgFactory.instance()
        known = factory.find_class(type_name)
        if known is not None:
            return known
        try:
            answer = await self.call(methods.GET_TYPE, master.GetTypeRequest(type_name=type_name))
        except ForeignMaster:
            return factory.get_class(type_name)
        if not answer.known:
            return factory.get_class(type_name)
        return message_class(answer.files, type_name)

    async def watch_graph(self) -> AsyncIterator[GraphSnapshot | GraphChange]:
        """The whole graph, then each change as it happens.

        A second snapshot replaces everything before it; it comes when this watcher was too slow.

        Raises:
            MasterUnavailable: Nobody answers, or the Master went away.
            ForeignMaster: It is a C++ Master.
        """
        async with contextlib.aclosing(
            self.stream(methods.WATCH_GRAPH, master.WatchGraphRequest())
        ) as events:
            async for event in events:
                if event.WhichOneof("kind") == "snapshot":
                    yield snapshot_from_proto(event.snapshot)
                else:
                    yield change_from_proto(event.change)

    async def stream(
        self, method: Method[Request, Response], request: Request
    ) -> AsyncGenerator[Response, None]:
        """One call with a stream of answers.

        Raises:
            MasterUnavailable: Nobody answers, or the Master went away.
            ForeignMaster: The Master has no such call.
            grpc.aio.AioRpcError: Any other status.
        """
        stub = self._channel.unary_stream(
            method.path,
            request_serializer=method.request.SerializeToString,
            response_deserializer=method.response.FromString,
        )
        call = stub(request)
        try:
            async for response in call:
                yield response
        except grpc.aio.AioRpcError as error:
            raise self._translated(error) from None
        except asyncio.CancelledError:
            if _is_cancelled():
                raise
            raise MasterUnavailable(self.address, "connection closed") from None
        finally:
            call.cancel()

    def lease(self) -> LeaseStream:
        """A lease to open; opening waits until a Master is there."""
        method = methods.LEASE
        stub = self._channel.stream_stream(
            method.path,
            request_serializer=method.request.SerializeToString,
            response_deserializer=method.response.FromString,
        )
        return LeaseStream(stub(wait_for_ready=True))

    async def wait_until_lost(self) -> None:
        """Return when the connection to the Master has stood and is gone.

        For Masters with no leases.
        """
        state = self._channel.get_state(try_to_connect=True)
        stood = False
        while not (stood and state is not grpc.ChannelConnectivity.READY):
            stood = state is grpc.ChannelConnectivity.READY
            await self._channel.wait_for_state_change(state)
            state = self._channel.get_state(try_to_connect=True)


def _is_cancelled() -> bool:
    """Whether it is this task that is cancelled; gRPC says the same when its channel is closed."""
    task = asyncio.current_task()
    return task is not None and task.cancelling() > 0
