"""The calls of the Master over gRPC.

Thin shell: it decodes, asks, and lets the effects be carried out before the answer leaves.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from functools import partial
from typing import Any, TypeAlias, TypeVar

import grpc
from google.protobuf.message import DecodeError, Message

from simple_ros.rpc import master_pb2 as master
from simple_ros.rpc import methods
from simple_ros.rpc import services_pb2 as srv
from simple_ros.rpc.methods import Method
from simple_ros_master import queries, type_registry
from simple_ros_master.leases import Mailbox
from simple_ros_master.parameters import MasterParameters
from simple_ros_master.peers import Effect
from simple_ros_master.switchboard import Switchboard

__all__ = ["generic_handlers"]

Request = TypeVar("Request", bound=Message)
Response = TypeVar("Response", bound=Message)
Context: TypeAlias = "grpc.aio.ServicerContext[Any, Any]"
Handler: TypeAlias = "grpc.RpcMethodHandler[Any, Any]"


def generic_handlers(
    board: Switchboard, parameters: MasterParameters
) -> list[grpc.GenericRpcHandler]:
    """All calls of a Master, for ``grpc.aio.Server.add_generic_rpc_handlers``."""
    directory = board.directory
    ros_rpc = [
        _change(board, methods.SUBSCRIBE, directory.subscribe),
        _change(board, methods.REGISTER_PUBLISHER, directory.register_publisher),
        _change(board, methods.UNSUBSCRIBE, directory.unsubscribe),
        _change(board, methods.UNREGISTER_PUBLISHER, directory.unregister_publisher),
        _answer(methods.GET_NODES, partial(queries.get_nodes, directory)),
        _answer(methods.GET_NODE_INFO, partial(queries.get_node_info, directory)),
        _answer(methods.GET_TOPICS, partial(queries.get_topics, directory)),
        _answer(methods.GET_TOPIC_INFO, partial(queries.get_topic_info, directory)),
    ]
    ours = [
        _stream(
            methods.LEASE, grpc.stream_stream_rpc_method_handler, partial(_lease, board, parameters)
        ),
        _stream(methods.WATCH_GRAPH, grpc.unary_stream_rpc_method_handler, partial(_watch, board)),
        _answer(methods.EXPORT_GRAPH, partial(_export, board)),
        _answer(
            methods.DECLARE_TYPE,
            partial(type_registry.declare_type, board.types, board.types_in_use),
        ),
        _answer(methods.GET_TYPE, partial(type_registry.get_type, board.types)),
    ]
    return [
        grpc.method_handlers_generic_handler(methods.ROS_RPC_SERVICE, dict(ros_rpc)),
        grpc.method_handlers_generic_handler(methods.MASTER_SERVICE, dict(ours)),
        grpc.method_handlers_generic_handler(methods.SERVICE_DIRECTORY, dict(_services(board))),
        grpc.method_handlers_generic_handler(
            methods.PARAMETER_SERVICE, dict(_parameters(parameters))
        ),
    ]


def _parameters(parameters: MasterParameters) -> list[tuple[str, Handler]]:
    desk = parameters.desk
    return [
        _answer(methods.GET_PARAMETERS, desk.get),
        _answer(methods.LIST_PARAMETERS, desk.list_names),
        _answer(methods.DESCRIBE_PARAMETERS, desk.describe),
        _answer(methods.DECLARE_PARAMETERS, parameters.declare),
        _awaited(methods.SET_PARAMETERS, desk.set),
        _awaited(methods.DELETE_PARAMETERS, desk.delete),
        _stream(methods.WATCH_PARAMETERS, grpc.unary_stream_rpc_method_handler, parameters.watch),
    ]


def _services(board: Switchboard) -> list[tuple[str, Handler]]:
    services = board.services
    return [
        _change(board, methods.REGISTER_SERVICE, services.register),
        _change(board, methods.UNREGISTER_SERVICE, services.unregister),
        _answer(methods.GET_SERVICES, services.get),
        _stream(
            methods.FIND_SERVICE,
            grpc.unary_unary_rpc_method_handler,
            partial(_find_service, board),
        ),
    ]


async def _find_service(
    board: Switchboard, request: srv.FindServiceRequest | None, context: Context
) -> srv.FindServiceResponse:
    if request is None:
        await context.abort(grpc.StatusCode.INVALID_ARGUMENT, "no FindServiceRequest")
    with board.news_of_services() as news:
        # The caller's deadline ends the wait: gRPC cancels this.
        while (found := board.services.find(request.name)) is None and request.wait:
            news.clear()
            await news.wait()
    return srv.FindServiceResponse(found=found is not None, service=found)


def _stream(
    method: Method[Request, Response], kind: Callable[..., Handler], behaviour: Callable[..., Any]
) -> tuple[str, Handler]:
    def parse(data: bytes) -> Request | None:
        try:
            return method.request.FromString(data)
        except DecodeError:
            # gRPC would log a traceback for each; the caller is told by the handler.
            return None

    return method.name, kind(
        behaviour,
        request_deserializer=parse,
        response_serializer=method.response.SerializeToString,
    )


def _answer(
    method: Method[Request, Response], answer: Callable[[Request], Response | None]
) -> tuple[str, Handler]:
    async def handle(request: Request | None, context: Context) -> Response:
        if request is None:
            await context.abort(grpc.StatusCode.INVALID_ARGUMENT, f"no {method.request.__name__}")
        response = answer(request)
        if response is None:
            await context.abort(grpc.StatusCode.NOT_FOUND, "Topic not found")
        return response

    return _stream(method, grpc.unary_unary_rpc_method_handler, handle)


def _awaited(
    method: Method[Request, Response], answer: Callable[[Request], Awaitable[Response]]
) -> tuple[str, Handler]:
    async def handle(request: Request | None, context: Context) -> Response:
        if request is None:
            await context.abort(grpc.StatusCode.INVALID_ARGUMENT, f"no {method.request.__name__}")
        return await answer(request)

    return _stream(method, grpc.unary_unary_rpc_method_handler, handle)


def _change(
    board: Switchboard,
    method: Method[Request, Response],
    change: Callable[[Request], tuple[Response, Sequence[Effect]]],
) -> tuple[str, Handler]:
    def answer(request: Request) -> Response:
        response, effects = change(request)
        board.apply(effects)
        return response

    return _answer(method, answer)


async def _lease(
    board: Switchboard,
    parameters: MasterParameters,
    requests: AsyncIterator[master.LeaseRequest | None],
    context: Context,
) -> None:
    first = await anext(requests, None)
    if first is None or not first.HasField("open"):
        await context.abort(grpc.StatusCode.INVALID_ARGUMENT, "the first message opens a lease")
    box = board.desk.open()
    hearing = asyncio.create_task(_hear(requests, box, parameters))
    try:
        board.apply(board.directory.open_lease(box.number, first.open.node_info))
        while (event := await box.get()) is not None:
            await context.write(event)
    finally:
        parameters.lease_ended(box.number)
        board.apply(board.directory.close_lease(box.number))
        board.desk.close(box)
        hearing.cancel()
        await asyncio.gather(hearing, return_exceptions=True)
    if box.error:
        await context.abort(grpc.StatusCode.INVALID_ARGUMENT, box.error)


async def _hear(
    requests: AsyncIterator[master.LeaseRequest | None],
    box: Mailbox,
    parameters: MasterParameters,
) -> None:
    try:
        async for request in requests:
            if request is None or request.HasField("release"):
                return
            parameters.heard(box.number, request)
    finally:
        box.end()


async def _watch(board: Switchboard, _request: master.WatchGraphRequest, context: Context) -> None:
    with board.watching() as (feed, news):
        while True:
            news.clear()
            while (event := feed.take()) is not None:
                await context.write(event)
            await news.wait()


def _export(board: Switchboard, request: master.ExportGraphRequest) -> master.ExportGraphResponse:
    graph = board.directory.graph
    formats = {
        master.GRAPH_FORMAT_DOT: graph.to_dot,
        master.GRAPH_FORMAT_JSON: graph.to_json,
    }
    text = formats.get(request.format, graph.to_readable_string)()
    return master.ExportGraphResponse(text=text)
