"""A page with a feed: files by HTTP, states and commands over one WebSocket.

It listens where it is told to, and asks nobody for a name: whoever reaches it may use it. A page of another origin
may not.
"""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from http import HTTPStatus
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from simple_ros.errors import ConfigError, SimpleRosError

__all__ = ["Feed", "PageServer"]

logger = logging.getLogger(__name__)

_KINDS = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
}
_MOST_BYTES = 65536

Feed = Callable[[], dict[str, Any]]
"""What to send next; each page that is open has its own."""


class PageServer:
    """Serves a folder and a feed.

    Args:
        folder: Its files are served, ``index.html`` as ``/``.
        feed: Called for each page that is opened; gives what is called for each state.
        command: Does what a page asks for and says what was done.
        period_s: Between states.

    Attributes:
        url: Where it is, while it listens.
    """

    def __init__(
        self,
        folder: Path,
        feed: Callable[[], Feed],
        command: Callable[[dict[str, Any]], str] | None = None,
        period_s: float = 0.5,
    ) -> None:
        self.url = ""
        self._files = {f"/{path.name}": path for path in folder.iterdir() if path.suffix in _KINDS}
        self._files["/"] = folder / "index.html"
        self._feed = feed
        self._command = command
        self._period_s = period_s

    @asynccontextmanager
    async def listening(self, host: str, port: int) -> AsyncIterator[str]:
        """Listen; gives the URL, which is empty if that is not possible: the node goes on without a page."""
        try:
            server = await serve(
                self._connected,
                host,
                port,
                process_request=self._answer,
                max_size=_MOST_BYTES,
            )
        except OSError as error:
            logger.error("no page on %s:%s: %s", host, port, error.strerror or error)  # noqa: TRY400
            yield ""
            return
        bound = next(iter(server.sockets)).getsockname()[1]
        shown = f"[{host}]" if ":" in host else host
        self.url = f"http://{shown}:{bound}/"
        async with server:
            yield self.url

    async def _connected(self, connection: ServerConnection) -> None:
        sending = asyncio.create_task(self._send_states(connection))
        try:
            async for text in connection:
                await connection.send(json.dumps(self._obey(text)))
        except ConnectionClosed:
            logger.debug("a page's connection broke")
        finally:
            sending.cancel()
            (ended,) = await asyncio.gather(sending, return_exceptions=True)
            if isinstance(ended, Exception) and not isinstance(ended, ConnectionClosed):
                logger.error("a page gets no states any more", exc_info=ended)

    async def _send_states(self, connection: ServerConnection) -> None:
        state = self._feed()
        while True:
            await connection.send(json.dumps({"op": "state", **state()}))
            await asyncio.sleep(self._period_s)

    def _obey(self, text: str | bytes) -> dict[str, Any]:
        try:
            said = json.loads(text)
            if self._command is None or not isinstance(said, dict):
                raise ConfigError("not understood")
            return {"op": "answer", "ok": True, "message": self._command(said)}
        except (SimpleRosError, ValueError) as error:
            return {"op": "answer", "ok": False, "message": " ".join(str(error).split())}

    def _answer(self, _: ServerConnection, request: Request) -> Response | None:
        """Files by HTTP; None to go on with a WebSocket."""
        path = urlsplit(request.path).path
        if path == "/feed":
            return None if _same_origin(request.headers) else _text(HTTPStatus.FORBIDDEN)
        file = self._files.get(path)
        if file is None:
            return _text(HTTPStatus.NOT_FOUND)
        return _response(HTTPStatus.OK, _KINDS[file.suffix], file.read_bytes())


def _same_origin(headers: Headers) -> bool:
    """Whether a page asks that came from here; programs send no origin."""
    origin = headers.get("Origin")
    return origin is None or urlsplit(origin).netloc == headers.get("Host")


def _text(status: HTTPStatus) -> Response:
    return _response(status, "text/plain", f"{status.value} {status.phrase}\n".encode())


def _response(status: HTTPStatus, kind: str, body: bytes) -> Response:
    headers = Headers(
        {
            "Content-Type": kind,
            "Content-Length": str(len(body)),
            "Cache-Control": "no-store",
            "Content-Security-Policy": "default-src 'self'; connect-src 'self' ws: wss:",
        }
    )
    return Response(status, status.phrase, headers, body)
