"""The store's network face: InfluxDB's HTTP writes and queries, and lines over UDP.

``POST /write`` and ``/api/v2/write`` take line protocol, ``POST /api/v2/query`` takes the Flux of
`store.flux`, ``GET /ping`` and ``/health`` say that it lives, ``/query`` accepts ``CREATE DATABASE``, which
writers of InfluxDB 1 begin with. There is no access control: it listens on loopback unless told otherwise.
"""

from __future__ import annotations

import asyncio
import json
import logging
import sqlite3
import time
from urllib.parse import parse_qs

from simple_ros_engines.store.annotated_csv import distinct_csv, last_csv
from simple_ros_engines.store.database import MetricsStore
from simple_ros_engines.store.flux import BadFlux, parse_flux
from simple_ros_engines.store.http import (
    MAX_HEAD,
    Answer,
    Request,
    framed,
    read_request,
    refused,
)
from simple_ros_engines.store.line_protocol import (
    PRECISIONS_NS,
    BadLine,
    Point,
    flexric_line,
    parse_lines,
)

__all__ = ["StoreServer"]

logger = logging.getLogger(__name__)

_IDLE_S = 60.0
_FLUSH_S = 0.2
_CLOSE_S = 1.0


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
        self._connections: dict[asyncio.StreamWriter, asyncio.Task[None] | None] = {}
        self._flushing: asyncio.Task[None] | None = None

    async def start(
        self, host: str = "127.0.0.1", port: int = 8086, udp_port: int | None = 8094
    ) -> None:
        """Listen; port 0 takes any free one, ``udp_port`` None leaves UDP out.

        Raises:
            OSError: A port is taken.
        """
        self._server = await asyncio.start_server(self._connected, host, port, limit=MAX_HEAD)
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
        told = ""
        while True:
            await asyncio.sleep(_FLUSH_S)
            try:
                self._store.flush()
                told = ""
            except sqlite3.Error as error:
                if str(error) != told:
                    logger.error("the store's file cannot be written: %s", error)  # noqa: TRY400
                told = str(error)

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
            await self._end_connections()
            await self._server.wait_closed()

    async def _end_connections(self) -> None:
        tasks = [task for task in self._connections.values() if task is not None]
        for writer in tuple(self._connections):
            writer.close()
        if tasks:
            # They end by themselves when their connection has; what is cancelled here leaves a traceback.
            await asyncio.wait(tasks, timeout=_CLOSE_S)

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
        self._connections[writer] = asyncio.current_task()
        try:
            while True:
                async with asyncio.timeout(_IDLE_S):
                    request = await read_request(reader, writer)
                answer = request if isinstance(request, Answer) else self._safely(request)
                writer.write(framed(answer))
                await writer.drain()
                if isinstance(request, Answer) or request.is_last:
                    break
        except (asyncio.IncompleteReadError, ConnectionError, TimeoutError):
            logger.debug("a client of the store left")
        finally:
            self._connections.pop(writer, None)
            writer.close()

    def _safely(self, request: Request) -> Answer:
        try:
            return self._answer(request)
        except sqlite3.Error as error:
            return refused(503, "unavailable", f"the store's file: {error}")

    def _answer(self, request: Request) -> Answer:
        match request.method, request.path:
            case "POST", "/write" | "/api/v2/write":
                return self._write(request)
            case "POST", "/api/v2/query":
                return self._query(request)
            case "GET" | "POST", "/query":
                return _statement(request)
            case "GET" | "HEAD", "/ping":
                return Answer(204)
            case "GET", "/health":
                return Answer(200, b'{"name":"simple-ros-store","status":"pass"}')
        return refused(404, "not found", f"there is no {request.method} {request.path}")

    def _write(self, request: Request) -> Answer:
        unit = request.query.get("precision", "ns")
        if unit not in PRECISIONS_NS:
            return refused(400, "invalid", f"precision {unit!r} is none of {list(PRECISIONS_NS)}")
        bad = self.take(request.body.decode("utf-8", "replace"), PRECISIONS_NS[unit])
        return Answer(204) if bad is None else refused(400, "invalid", str(bad))

    def _query(self, request: Request) -> Answer:
        text = request.body.decode("utf-8", "replace")
        try:
            if request.headers.get("content-type", "").startswith("application/json"):
                text = str(json.loads(text)["query"])
            query = parse_flux(text, time.time_ns())
        except (BadFlux, ValueError, KeyError, TypeError, RecursionError) as error:
            return refused(400, "invalid", f"query: {error}")
        if query.distinct is None:
            body = last_csv(self._store.last(query), query.start_ns, query.stop_ns)
        else:
            body = distinct_csv(query.distinct, self._store.distinct(query))
        return Answer(200, body.encode(), "text/csv; charset=utf-8")


def _statement(request: Request) -> Answer:
    """InfluxQL: only what writers begin with."""
    form = {name: values[-1] for name, values in parse_qs(request.body.decode("latin-1")).items()}
    text = request.query.get("q") or form.get("q", "")
    if text.strip().upper().startswith("CREATE DATABASE"):
        return Answer(200, b'{"results":[{"statement_id":0}]}')
    return refused(400, "invalid", f"InfluxQL is not understood, Flux is: {text[:80]!r}")


class _Lines(asyncio.DatagramProtocol):
    """Lines of line protocol, or of FlexRIC, in datagrams."""

    def __init__(self, server: StoreServer) -> None:
        self._server = server
        self._told = False

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        """Take lines."""
        lines = data.decode("utf-8", "replace").splitlines()
        try:
            bad = self._server.take("\n".join(flexric_line(line) for line in lines))
        except sqlite3.Error:
            # The flush that follows says so, once.
            return
        if bad is not None and not self._told:
            self._told = True
            logger.warning("a datagram from %s has bad lines, dropped: %s", addr[0], bad)
