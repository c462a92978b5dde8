"""Doubles for tests of a Master: a bare node and a bare client, both as simple as C++ ones.

They share no code with the Master's own side of the wire.
"""

from __future__ import annotations

import asyncio
import socket
import struct
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType
from typing import Any, Self, TypeVar

import grpc
from google.protobuf.message import Message

from simple_ros.rpc import ros_rpc_pb2 as ros
from simple_ros.rpc.methods import Method

__all__ = ["BareClient", "BareNode"]

Request = TypeVar("Request", bound=Message)
Response = TypeVar("Response", bound=Message)

TIMEOUT_S = 30.0


class BareNode:
    """A listener that writes down every push it gets and never answers.

    Args:
        name: Its node name.
        hang_up: Close each connection after one frame.

    Attributes:
        raw: All bytes received, over all connections.
        accepted: How many connections there were.
        port: Where it listens, or did last.
    """

    def __init__(self, name: str, *, hang_up: bool = False) -> None:
        self.name = name
        self.raw = bytearray()
        self.accepted = 0
        self.port = 0
        self._hang_up = hang_up
        self._updates: asyncio.Queue[ros.TopicTargetsUpdate] = asyncio.Queue()
        self._listener: socket.socket | None = None
        self._serving: set[asyncio.Task[None]] = set()
        self._writers: set[asyncio.StreamWriter] = set()
        self._changed = asyncio.Condition()

    async def __aenter__(self) -> Self:
        await self.listen()
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        await self.stop_listening()

    def info(self, **extra: Any) -> ros.NodeInfo:
        """How it describes itself; ``extra`` are further fields."""
        return ros.NodeInfo(ip="127.0.0.1", port=self.port, node_name=self.name, **extra)

    async def listen(self) -> None:
        """Listen, on the same port as before if there was one."""
        # Not asyncio's server: closing one while a connection comes in leaves that one open.
        self._listener = socket.create_server(("127.0.0.1", self.port))
        self._listener.setblocking(False)
        self.port = self._listener.getsockname()[1]
        asyncio.get_running_loop().add_reader(self._listener, self._accept, self._listener)

    async def stop_listening(self) -> None:
        """Close the listener and every connection, as the end of a process does."""
        listener, self._listener = self._listener, None
        if listener is not None:
            asyncio.get_running_loop().remove_reader(listener)
            listener.close()
        await self.close_connections()
        await self.until(lambda: not self._serving)

    async def close_connections(self) -> None:
        """Close every connection and go on listening."""
        for writer in list(self._writers):
            writer.close()
        await self.until(lambda: not self._writers)

    async def connected(self, times: int = 1) -> None:
        """Wait until it has accepted that many connections in all."""
        await self.until(lambda: self.accepted >= times)

    async def until(self, condition: Callable[[], bool]) -> None:
        """Wait until a condition holds that connections bring about."""
        async with asyncio.timeout(TIMEOUT_S), self._changed:
            await self._changed.wait_for(condition)

    async def next_update(self) -> ros.TopicTargetsUpdate:
        """The next push."""
        async with asyncio.timeout(TIMEOUT_S):
            return await self._updates.get()

    @property
    def waiting(self) -> int:
        """How many pushes arrived that were not asked for yet."""
        return self._updates.qsize()

    def _accept(self, listener: socket.socket) -> None:
        connection, _ = listener.accept()
        self.accepted += 1
        self._serving.add(asyncio.create_task(self._serve(connection)))

    async def _serve(self, connection: socket.socket) -> None:
        reader, writer = await asyncio.open_connection(sock=connection)
        self._writers.add(writer)
        await self._notify()
        try:
            while self._listener is not None and not writer.is_closing():
                await self._read_frame(reader)
                if self._hang_up:
                    return
        except (asyncio.IncompleteReadError, ConnectionError):
            return
        finally:
            writer.close()
            with suppress(ConnectionError):
                await writer.wait_closed()
            self._writers.discard(writer)
            self._serving = {task for task in self._serving if task is not asyncio.current_task()}
            await self._notify()

    async def _notify(self) -> None:
        async with self._changed:
            self._changed.notify_all()

    async def _read_frame(self, reader: asyncio.StreamReader) -> None:
        parts = []
        for form in (">H", ">H", ">I"):
            size = await reader.readexactly(struct.calcsize(form))
            body = await reader.readexactly(struct.unpack(form, size)[0])
            self.raw += size + body
            parts.append(body)
        assert parts[1] == b"TopicTargetsUpdate"
        self._updates.put_nowait(ros.TopicTargetsUpdate.FromString(parts[2]))


class BareClient:
    """Calls to a Master, message in and message out."""

    def __init__(self, address: str) -> None:
        self.channel = grpc.aio.insecure_channel(
            address, options=[("grpc.use_local_subchannel_pool", 1)]
        )

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        await self.channel.close()

    async def call(self, method: Method[Request, Response], request: Request) -> Response:
        """One unary call.

        Raises:
            grpc.aio.AioRpcError: It ended with another status than OK.
        """
        response: Response = await self.channel.unary_unary(
            method.path,
            request_serializer=method.request.SerializeToString,
            response_deserializer=method.response.FromString,
        )(request, timeout=TIMEOUT_S)
        return response

    def stream(self, method: Method[Any, Any], request: Message | None = None) -> Any:
        """A call that streams answers to one request, or both ways without one."""
        kind = self.channel.stream_stream if request is None else self.channel.unary_stream
        call: Any = kind(
            method.path,
            request_serializer=method.request.SerializeToString,
            response_deserializer=method.response.FromString,
        )
        return call() if request is None else call(request)
