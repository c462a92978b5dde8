"""Which addresses a node has, and which of them it shows to others."""

from __future__ import annotations

import asyncio
import ipaddress
import os
import socket
import struct
from dataclasses import dataclass

from simple_ros.errors import ConfigError

__all__ = [
    "DEFAULT_MASTER",
    "RESERVED_PORTS",
    "ConnectionState",
    "address_of",
    "connection_state",
    "find_own_ipv4",
    "further_addresses",
    "is_loopback",
    "is_tcp",
    "join_address",
    "judge_connection",
    "keep_alive",
    "listening_socket",
    "master_address",
    "no_delay",
    "own_ipv4",
    "split_address",
]

DEFAULT_MASTER = "localhost:50051"
RESERVED_PORTS = frozenset({50052, 50053, 60002})
"""Fixed ports of C++ simple_ros tools, which abort when somebody else has them."""


def split_address(address: str, default_port: int | None = None) -> tuple[str, int]:
    """``host:port``, ``[v6]:port`` or ``host`` (with a default port) as a pair.

    Raises:
        ConfigError: It is none of these.
    """
    text = address.strip()
    host, colon, port = text.rpartition(":")
    if not colon or text.endswith("]") or (":" in host and not host.startswith("[")):
        host, port = text, "" if default_port is None else str(default_port)
    host = host.removeprefix("[").removesuffix("]")
    if not host or not (port.isascii() and port.isdigit()):
        raise ConfigError(f"{address!r} is not an address; write host:port or [v6]:port")
    if int(port) > 65535:
        raise ConfigError(f"{address!r} is not an address host:port: ports end at 65535")
    return host, int(port)


def address_of(text: str, what: str = "address") -> tuple[str, int]:
    """Where to listen, from ``[HOST:]PORT``: host and port; 127.0.0.1 if there is no host.

    Args:
        text: As somebody wrote it.
        what: What it is the address of, for the message.

    Raises:
        ConfigError: It is no such text.
    """
    host, _, port = text.rpartition(":")
    if not port.isdecimal() or int(port) > 65535:
        raise ConfigError(f"{what} {text!r} is not of the form [HOST:]PORT")
    return host.strip("[]") or "127.0.0.1", int(port)


def join_address(host: str, port: int) -> str:
    """The text form, with brackets around an IPv6 host."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def master_address(explicit: str | None = None) -> str:
    """Where the Master is: as given, else ``SIMPLE_ROS_MASTER``, else ``localhost:50051``.

    Raises:
        ConfigError: It is no address.
    """
    chosen = explicit or os.environ.get("SIMPLE_ROS_MASTER") or DEFAULT_MASTER
    return join_address(*split_address(chosen, default_port=50051))


def own_ipv4(master: str) -> str:
    """The dotted IPv4 that peers see, chosen by the route to the Master.

    ``127.0.0.1`` when the Master is on this host. A Master that only has an IPv6 address gives the
    first IPv4 of this host that is not loopback, or ``127.0.0.1``.
    """
    host, port = split_address(master)
    try:
        infos = socket.getaddrinfo(host, port, socket.AF_INET, socket.SOCK_DGRAM)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect(infos[0][4])
            return str(probe.getsockname()[0])
    except OSError:
        if is_loopback(host):
            return "127.0.0.1"
        others = [text for text in _interface_addresses() if ":" not in text]
        return others[0] if others else "127.0.0.1"


async def find_own_ipv4(master: str) -> str:
    """As `own_ipv4`, without holding up the event loop while a host name is looked up."""
    host, _ = split_address(master)
    if host == "localhost" or host.replace(".", "").isdigit() or ":" in host:
        return own_ipv4(master)
    return await asyncio.to_thread(own_ipv4, master)


def further_addresses(ip: str, port: int) -> tuple[str, ...]:
    """``host:port`` of this host's other interfaces, for peers that cannot reach ``ip``."""
    if is_loopback(ip):
        return ()
    return tuple(join_address(text, port) for text in _interface_addresses() if text != ip)


def _interface_addresses() -> list[str]:
    import psutil

    families = (socket.AF_INET, socket.AF_INET6)
    found = [
        entry.address
        for entries in psutil.net_if_addrs().values()
        for entry in entries
        if entry.family in families and "%" not in entry.address
    ]
    return sorted(
        (text for text in found if not is_loopback(text)), key=lambda text: (":" in text, text)
    )


def is_loopback(host: str) -> bool:
    """Whether a host, as written, can only mean this one."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def listening_socket(host: str, port: int) -> socket.socket:
    """A bound, listening TCP socket; port 0 gives any free port that is not reserved.

    Raises:
        OSError: The address cannot be bound.
    """
    refused: list[socket.socket] = []
    try:
        while True:
            sock = _bind(host, port)
            if port or sock.getsockname()[1] not in RESERVED_PORTS:
                sock.listen(socket.SOMAXCONN)
                return sock
            refused.append(sock)
    finally:
        for sock in refused:
            sock.close()


def _bind(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # The protocol is named because asyncio turns Nagle's algorithm off only where it is.
    sock = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if family == socket.AF_INET6:
            sock.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        sock.setblocking(False)
        sock.bind((host, port))
    except OSError:
        sock.close()
        raise
    return sock


def is_tcp(sock: socket.socket | None) -> bool:
    """Whether it is a TCP socket; other transports have others, or none."""
    internet = (socket.AF_INET, socket.AF_INET6)
    return sock is not None and sock.family in internet and sock.type == socket.SOCK_STREAM


def keep_alive(sock: socket.socket | None, *, idle_s: float = 8.0) -> None:
    """Let the kernel notice a peer host that vanished, on a link that carries nothing.

    Args:
        sock: A connected socket; nothing happens if it is not TCP's.
        idle_s: How long it may give no sign of life, rounded to whole seconds, at least 2.
    """
    if sock is None or not is_tcp(sock):
        return
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    probes = max(1, min(3, round(idle_s) // 2))
    settings = {
        "TCP_KEEPIDLE": max(1, round(idle_s) - probes),
        "TCP_KEEPINTVL": 1,
        "TCP_KEEPCNT": probes,
    }
    for name, value in settings.items():
        option = getattr(socket, name, None)
        if option is not None:
            sock.setsockopt(socket.IPPROTO_TCP, option, value)


def no_delay(sock: socket.socket) -> None:
    """Let small messages go at once, if the socket is TCP's."""
    if is_tcp(sock):
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)


@dataclass(frozen=True, slots=True)
class ConnectionState:
    """What the kernel knows of a connection that carries data.

    Attributes:
        is_under_way: Whether something sent is not acknowledged yet.
        is_silent: Whether the peer's host has answered nothing for 8 s although it was asked:
            by retransmissions, or by probes of a full window. A peer that reads nothing but whose
            kernel answers is not silent, and `TCP_USER_TIMEOUT` would not tell the two apart.
    """

    is_under_way: bool
    is_silent: bool


_SILENT_MS = 8000
_UNANSWERED_PROBES = 4
# struct tcp_info of Linux: retransmits, probes; unacked; last_ack_recv (ms ago).
_TCP_INFO = struct.Struct("=2xBB20xI28xI")


def connection_state(sock: socket.socket | None) -> ConnectionState:
    """Look at a connected TCP socket; where the kernel does not tell, nothing is silent."""
    option = getattr(socket, "TCP_INFO", None)
    if option is None or sock is None or not is_tcp(sock):
        return ConnectionState(is_under_way=False, is_silent=False)
    raw = sock.getsockopt(socket.IPPROTO_TCP, option, _TCP_INFO.size)
    if len(raw) < _TCP_INFO.size:
        return ConnectionState(is_under_way=False, is_silent=False)
    return judge_connection(*_TCP_INFO.unpack(raw))


def judge_connection(
    retransmits: int, probes: int, unacked: int, last_ack_ms: int
) -> ConnectionState:
    """The verdict on what ``TCP_INFO`` says."""
    asked = (unacked > 0 and retransmits > 0) or probes >= _UNANSWERED_PROBES
    return ConnectionState(
        is_under_way=unacked > 0 or probes > 0,
        is_silent=asked and last_ack_ms > _SILENT_MS,
    )
