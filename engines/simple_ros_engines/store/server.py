"""The store's network face: InfluxDB's HTTP writes and queries, and lines over UDP.

``POST /write`` and ``/api/v2/write`` take line protocol, ``POST /api/v2/query`` takes the Flux of
`store.flux`, ``GET /ping`` and ``/health`` say that it lives. There is no access control: it listens on
loopback unless told otherwise.
"""

from __future__ import annotations

import asyncio
import gzip
import json
import logging
import time
import zlib
from dataclasses import dataclass, field
from urllib.parse import parse_qs, urlsplit

from simple_ros_engines.store.annotated_csv import distinct_csv, last_csv
from simple_ros_engines.store.database import MetricsStore
from simple_ros_engines.store.flux import BadFlux, parse_flux
from simple_ros_engines.store.line_protocol import (
    PRECISIONS_NS,
    BadLine,
    Point,
    flexric_line,
    parse_lines,
)

__all__ = ["StoreServer"]

logger = logging.getLogger(__name__)

_MAX_BODY = 25 * 1024 * 1024
_MAX_HEAD = 32 * 1024
_IDLE_S = 60.0
_FLUSH_S = 0.2


@dataclass(slots=True)
class _Answer:
    status: int
    body: bytes = b""
    content_type: str = "application/json; charset=utf-8"


@dataclass(slots=True)
class _Request:
    method: str
    path: str
    query: dict[str, str]
    headers: dict[str, str] = field(default_factory=dict)
    body: bytes = b""


_REASONS = {200: "OK", 204: "No Content", 400: "Bad Request", 404: "Not Found", 413: "Too Large"}


def _refused(status: int, code: str, message: str) -> _Answer:
    return _Answer(status, json.dumps({"code": code, "message": message}).encode())


class StoreServer:
    """Serves one store.

    Args:
        store: What is served; used in the event loop's thread.

    Attributes:
        written: Points taken.
        bad_lines: Lines that were none.
    """

    def __init__(self, store: MetricsStore) -> None:
        self.written = 0
        self.bad_lines = 0
        self._store = store
        self._server: asyncio.Server | None = None
        self._udp: asyncio.DatagramTransport | None = None
        self._connections: set[asyncio.StreamWriter] = set()
        self._flushing: asyncio.Task[None] | None = None

    async def start(
        self, host: str = "127.0.0.1", port: int = 8086, udp_port: int | None = 8094
    ) -> None:
        """Listen; port 0 takes any free one, ``udp_port`` None leaves UDP out.

        Raises:
            OSError: A port is taken.
        """
        self._server = await asyncio.start_server(self._connected, host, port, limit=_MAX_HEAD)
        if udp_port is not None:
            loop = asyncio.get_running_loop()
            try:
                self._udp, _ = await loop.create_datagram_endpoint(
                    lambda: _Lines(self), local_addr=(host, udp_port)
                )
            except OSError:
                await self.close()
                raise
        self._flushing = asyncio.create_task(self._flush())

    async def _flush(self) -> None:
        while True:
            await asyncio.sleep(_FLUSH_S)
            self._store.flush()

    @property
    def port(self) -> int:
        """Where it listens for HTTP."""
        assert self._server is not None
        return int(self._server.sockets[0].getsockname()[1])

    @property
    def udp_port(self) -> int:
        """Where it listens for lines."""
        assert self._udp is not None
        return int(self._udp.get_extra_info("sockname")[1])

    async def close(self) -> None:
        """Stop listening and end every connection."""
        if self._flushing is not None:
            self._flushing.cancel()
            await asyncio.gather(self._flushing, return_exceptions=True)
        if self._udp is not None:
            self._udp.close()
        if self._server is not None:
            self._server.close()
            for writer in list(self._connections):
                writer.close()
            await self._server.wait_closed()

    def take(self, text: str, unit_ns: int = 1) -> BadLine | None:
        """Take lines; the good ones count even if others are bad. Gives the first bad one."""
        good: list[Point] = []
        first: BadLine | None = None
        for item in parse_lines(text, unit_ns):
            if isinstance(item, BadLine):
                self.bad_lines += 1
                first = first or item
            else:
                good.append(item)
        self.written += self._store.write(good, time.time_ns())
        return first

    async def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._connections.add(writer)
        try:
            while True:
                async with asyncio.timeout(_IDLE_S):
                    request = await _read(reader)
                answer = request if isinstance(request, _Answer) else self._answer(request)
                writer.write(_framed(answer))
                await writer.drain()
                if isinstance(request, _Answer):
                    break
        except (asyncio.IncompleteReadError, ConnectionError, TimeoutError):
            logger.debug("a client of the store left")
        finally:
            self._connections.discard(writer)
            writer.close()

    def _answer(self, request: _Request) -> _Answer:
        match request.method, request.path:
            case "POST", "/write" | "/api/v2/write":
                return self._write(request)
            case "POST", "/api/v2/query":
                return self._query(request)
            case "GET" | "HEAD", "/ping":
                return _Answer(204)
            case "GET", "/health":
                return _Answer(200, b'{"name":"simple-ros-store","status":"pass"}')
        return _refused(404, "not found", f"there is no {request.method} {request.path}")

    def _write(self, request: _Request) -> _Answer:
        unit = request.query.get("precision", "ns")
        if unit not in PRECISIONS_NS:
            return _refused(400, "invalid", f"precision {unit!r} is none of {list(PRECISIONS_NS)}")
        bad = self.take(request.body.decode("utf-8", "replace"), PRECISIONS_NS[unit])
        return _Answer(204) if bad is None else _refused(400, "invalid", str(bad))

    def _query(self, request: _Request) -> _Answer:
        text = request.body.decode("utf-8", "replace")
        try:
            if request.headers.get("content-type", "").startswith("application/json"):
                text = str(json.loads(text)["query"])
            query = parse_flux(text, time.time_ns())
        except (BadFlux, ValueError, KeyError, TypeError) as error:
            return _refused(400, "invalid", f"query: {error}")
        if query.distinct is None:
            body = last_csv(self._store.last(query), query.start_ns, query.stop_ns)
        else:
            body = distinct_csv(query.distinct, self._store.distinct(query))
        return _Answer(200, body.encode(), "text/csv; charset=utf-8")


class _Lines(asyncio.DatagramProtocol):
    """Lines of line protocol, or of FlexRIC, in datagrams."""

    def __init__(self, server: StoreServer) -> None:
        self._server = server
        self._told = False

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        """Take lines."""
        lines = data.decode("utf-8", "replace").splitlines()
        bad = self._server.take("\n".join(flexric_line(line) for line in lines))
        if bad is not None and not self._told:
            self._told = True
            logger.warning("a datagram from %s has bad lines, dropped: %s", addr[0], bad)


async def _read(reader: asyncio.StreamReader) -> _Request | _Answer:
    try:
        head = (await reader.readuntil(b"\r\n\r\n")).decode("latin-1")
    except asyncio.LimitOverrunError:
        return _refused(413, "invalid", f"the head is over {_MAX_HEAD} bytes")
    first, *lines = head[:-4].split("\r\n")
    words = first.split(" ")
    if len(words) != 3:
        return _refused(400, "invalid", "that is no HTTP request")
    pairs = (line.partition(":") for line in lines)
    headers = {name.strip().lower(): value.strip() for name, _, value in pairs}
    length = headers.get("content-length", "0")
    if not length.isdigit() or int(length) > _MAX_BODY:
        return _refused(413, "invalid", f"the body must have a length of at most {_MAX_BODY} bytes")
    body = await reader.readexactly(int(length))
    if headers.get("content-encoding") == "gzip":
        unpacked = _unpacked(body)
        if unpacked is None:
            return _refused(400, "invalid", "the body is no gzip, or too large")
        body = unpacked
    target = urlsplit(words[1])
    query = {name: values[-1] for name, values in parse_qs(target.query).items()}
    return _Request(words[0], target.path, query, headers, body)


def _unpacked(body: bytes) -> bytes | None:
    unpacker = zlib.decompressobj(16 + zlib.MAX_WBITS)
    try:
        data = unpacker.decompress(body, _MAX_BODY)
    except (zlib.error, gzip.BadGzipFile):
        return None
    return None if unpacker.unconsumed_tail else data


def _framed(answer: _Answer) -> bytes:
    head = (
        f"HTTP/1.1 {answer.status} {_REASONS[answer.status]}\r\n"
        f"Content-Type: {answer.content_type}\r\nContent-Length: {len(answer.body)}\r\n"
        "X-Influxdb-Version: 2.0-simple-ros\r\n\r\n"
    )
    return head.encode() + answer.body
