"""A small HTTP server for JSON: for notifications, and for the mock network."""

from __future__ import annotations

import asyncio
import json
import logging
import ssl
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any

from simple_ros_engines.store.http import MAX_HEAD, Answer, Request, read_request

__all__ = ["Reply", "WebServer", "json_of"]

logger = logging.getLogger(__name__)

_IDLE_S = 30.0
_CLOSE_S = 1.0


@dataclass(frozen=True, slots=True)
class Reply:
    """What is answered.

    Attributes:
        status: Of HTTP.
        data: Becomes JSON; None for no body, bytes as they are.
        headers: Further ones.
        content_type: Of the body.
    """

    status: int
    data: Any = None
    headers: Mapping[str, str] = field(default_factory=dict)
    content_type: str = "application/json"


Handler = Callable[[Request], Awaitable[Reply | None]]


def json_of(request: Request) -> Any:
    """The JSON of a request.

    Raises:
        ValueError: It has none.
    """
    try:
        return json.loads(request.body)
    except RecursionError as error:
        raise ValueError("nested too deep") from error


class WebServer:
    """Serves.

    Args:
        handler: Makes the reply; None closes the connection without one.
        tls: For https.
    """

    def __init__(self, handler: Handler, tls: ssl.SSLContext | None = None) -> None:
        self._handler = handler
        self._tls = tls
        self._server: asyncio.Server | None = None
        self._connections: dict[asyncio.StreamWriter, asyncio.Task[None] | None] = {}

    async def start(self, host: str = "127.0.0.1", port: int = 0) -> None:
        """Listen; port 0 takes any free one.

        Raises:
            OSError: The port is taken.
        """
        self._server = await asyncio.start_server(
            self._connected, host, port, limit=MAX_HEAD, ssl=self._tls
        )

    @property
    def port(self) -> int:
        """Where it listens."""
        assert self._server is not None
        return int(self._server.sockets[0].getsockname()[1])

    @property
    def scheme(self) -> str:
        """``http`` or ``https``."""
        return "https" if self._tls else "http"

    async def close(self) -> None:
        """Stop listening and end every connection."""
        if self._server is None:
            return
        self._server.close()
        tasks = [task for task in self._connections.values() if task is not None]
        for writer in tuple(self._connections):
            writer.close()
        if tasks:
            await asyncio.wait(tasks, timeout=_CLOSE_S)
        await self._server.wait_closed()

    async def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._connections[writer] = asyncio.current_task()
        try:
            while await self._serve(reader, writer):
                continue
        except (asyncio.IncompleteReadError, ConnectionError, TimeoutError, ssl.SSLError):
            logger.debug("a client left")
        finally:
            self._connections.pop(writer, None)
            writer.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> bool:
        """Answer one request; whether another may follow."""
        async with asyncio.timeout(_IDLE_S):
            request = await read_request(reader, writer)
        if isinstance(request, Answer):
            writer.write(_framed(Reply(request.status), last=True))
            return False
        try:
            reply = await self._handler(request)
        except Exception:
            # One request's trouble must not end the server; the client is told.
            logger.exception("%s %s cannot be answered", request.method, request.path)
            reply = Reply(500, {"title": "Internal Server Error", "status": 500})
        if reply is None:
            return False
        writer.write(_framed(reply, last=request.is_last))
        await writer.drain()
        return not request.is_last


def _framed(reply: Reply, *, last: bool) -> bytes:
    body = b""
    if reply.data is not None:
        body = reply.data if isinstance(reply.data, bytes) else json.dumps(reply.data).encode()
    headers = {"Content-Length": str(len(body)), **reply.headers}
    if body:
        headers["Content-Type"] = reply.content_type
    if last:
        headers["Connection"] = "close"
    lines = "".join(f"{name}: {value}\r\n" for name, value in headers.items())
    return (
        f"HTTP/1.1 {reply.status} {HTTPStatus(reply.status).phrase}\r\n{lines}\r\n".encode() + body
    )
