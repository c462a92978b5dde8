"""A Master in one object: the gRPC server and everything behind it."""

from __future__ import annotations

import errno
import socket
import uuid
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import grpc

from simple_ros.errors import AddressInUse
from simple_ros.net.addresses import RESERVED_PORTS, join_address
from simple_ros.parameters.tree import ParameterTree
from simple_ros_master.graph import MessageGraph
from simple_ros_master.parameter_store import ParameterStore
from simple_ros_master.parameters import MasterParameters
from simple_ros_master.service import generic_handlers
from simple_ros_master.switchboard import Switchboard

__all__ = ["DEFAULT_PORT", "Master", "master_version"]

DEFAULT_PORT = 50051

_OPTIONS: list[tuple[str, Any]] = [
    ("grpc.so_reuseport", 0),
    # A host that vanished loses its lease within six seconds.
    ("grpc.keepalive_time_ms", 3000),
    ("grpc.keepalive_timeout_ms", 2500),
    ("grpc.http2.ping_timeout_ms", 3000),
    ("grpc.keepalive_permit_without_calls", 1),
    ("grpc.http2.max_pings_without_data", 0),
    # Nodes may probe us as well.
    ("grpc.http2.min_recv_ping_interval_without_data_ms", 1000),
    ("grpc.http2.min_ping_interval_without_data_ms", 1000),
    ("grpc.http2.max_ping_strikes", 0),
    ("grpc.max_send_message_length", -1),
    ("grpc.max_receive_message_length", 16 * 1024 * 1024),
]
_IN_USE_HINT = "; is another Master running there?"


def master_version() -> str:
    """The version of the installed distribution."""
    try:
        return version("simple-ros")
    except PackageNotFoundError:
        return "unknown"


class Master:
    """Serves nodes from `start` until `stop`; also an async context manager.

    Args:
        host: Address to listen on; ``0.0.0.0`` or ``::`` for all.
        port: 0 for any free port.
        parameters: A YAML file in which parameters that were set outlive the Master.
    """

    def __init__(
        self,
        *,
        host: str = "127.0.0.1",
        port: int = DEFAULT_PORT,
        parameters: str | Path | None = None,
    ) -> None:
        self._host = host
        self._port = port
        self._server: grpc.aio.Server | None = None
        self._board: Switchboard | None = None
        self._file = None if parameters is None else Path(parameters)
        self._parameters: MasterParameters | None = None

    @property
    def port(self) -> int:
        """The port it listens on, once started."""
        return self._port

    @property
    def address(self) -> str:
        """``host:port`` it listens on, once started."""
        return join_address(self._host, self._port)

    @property
    def graph(self) -> MessageGraph:
        """What is registered, to read; of a started Master only."""
        if self._board is None:
            raise RuntimeError("the Master was not started")
        return self._board.directory.graph

    @property
    def parameters(self) -> ParameterTree:
        """The parameters, to read; of a started Master only."""
        if self._parameters is None:
            raise RuntimeError("the Master was not started")
        return self._parameters.tree

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        await self.stop()

    async def start(self) -> None:
        """Listen and serve.

        Raises:
            AddressInUse: Somebody else listens there.
            OSError: The address is none of this host's, or may not be used.
            ConfigError: The file of parameters cannot be read.
            BadParameterText: It is no file of parameters; tells the line.
        """
        if self._server is not None:
            raise RuntimeError("the Master was started already")
        store = None if self._file is None else ParameterStore(self._file)
        _check_address(self._host, self._port)
        server, self._port = await _bind(self._host, self._port)
        self._board = Switchboard(uuid.uuid4().hex, master_version())
        self._parameters = MasterParameters(self._board, store)
        self._parameters.start()
        server.add_generic_rpc_handlers(generic_handlers(self._board, self._parameters))
        await server.start()
        self._server = server

    async def stop(self) -> None:
        """End all streams and connections; the graph stays readable. Stopping twice is fine."""
        server, self._server = self._server, None
        if server is not None and self._board is not None:
            await self._board.stop()
            if self._parameters is not None:
                await self._parameters.stop()
            await server.stop(None)


def _check_address(host: str, port: int) -> None:
    """Say what is wrong with an address, which gRPC does not.

    Raises:
        AddressInUse: Somebody else listens there.
        OSError: The address cannot be used.
    """
    address = join_address(host, port)
    try:
        infos = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        for family, kind, protocol, _, sockaddr in infos:
            with socket.socket(family, kind, protocol) as probe:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                probe.bind(sockaddr)
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise AddressInUse(address, _IN_USE_HINT) from None
        raise OSError(error.errno, f"cannot listen on {address}: {error.strerror}") from None


async def _bind(host: str, port: int) -> tuple[grpc.aio.Server, int]:
    """A server with its port; one that the system chose is none of those that C++ tools need."""
    passed_over: list[grpc.aio.Server] = []
    try:
        while True:
            server = grpc.aio.server(options=_OPTIONS)
            try:
                bound = server.add_insecure_port(join_address(host, port))
            except RuntimeError:
                raise AddressInUse(join_address(host, port), _IN_USE_HINT) from None
            if port or bound not in RESERVED_PORTS:
                return server, bound
            passed_over.append(server)
    finally:
        for server in passed_over:
            # Only a server that was started gives its port back.
            await server.start()
            await server.stop(None)
