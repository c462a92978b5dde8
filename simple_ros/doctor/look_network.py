"""Environment variables, names, addresses and ports of this host."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterable, Mapping

from simple_ros.doctor.judge_network import MASTER_VARIABLE, Environment, Listener, Network
from simple_ros.errors import ConfigError
from simple_ros.net.addresses import (
    DEFAULT_MASTER,
    is_loopback,
    master_address,
    own_ipv4,
    split_address,
)

__all__ = ["is_own", "look_at_environment", "look_at_listeners", "look_at_network"]

_LOOPBACK_LIMIT_S = 1.0
_PROXIES = ("grpc_proxy", "https_proxy", "http_proxy")
_EXEMPTIONS = ("no_grpc_proxy", "no_proxy")
_SHOWN_COMMAND = 60


def look_at_environment(master: str | None, environment: Mapping[str, str]) -> Environment:
    """Variables, and where the Master is as ``--master`` and they say."""
    if master:
        said_by = "--master"
    else:
        said_by = MASTER_VARIABLE if environment.get(MASTER_VARIABLE) else "default"
    try:
        address, problem = master_address(master), ""
    except ConfigError as error:
        address, problem = "", str(error)
    return Environment(
        master=address,
        master_from=said_by,
        master_problem=problem,
        names=tuple(sorted(environment)),
        proxies=tuple(name for name in _PROXIES if environment.get(name)),
        is_exempt=bool(address) and _is_exempt(split_address(address)[0], environment),
    )


def _is_exempt(host: str, environment: Mapping[str, str]) -> bool:
    for name in _EXEMPTIONS:
        if name in environment:  # the first that is set counts, as in gRPC
            endings = [part.strip().lstrip(".") for part in environment[name].split(",")]
            return any(part and (host == part or host.endswith(f".{part}")) for part in endings)
    return False


def look_at_network(master: str) -> Network:
    """Names and addresses; may wait long for a name server.

    Args:
        master: ``host:port``; empty if unknown.
    """
    hostname = socket.gethostname()
    start = time.monotonic()
    host_addresses = _resolved(hostname)
    lookup_s = time.monotonic() - start
    own = own_ipv4(master or DEFAULT_MASTER)
    return Network(
        hostname=hostname,
        host_addresses=host_addresses,
        lookup_s=lookup_s,
        localhost_addresses=_resolved("localhost"),
        loopback_problem=_loopback_problem(),
        has_ipv6=_has_ipv6(),
        interfaces=_interfaces(),
        own_address=own,
        is_master_local=_is_local(split_address(master)[0]) if master else None,
    )


def _resolved(name: str) -> tuple[str, ...]:
    try:
        infos = socket.getaddrinfo(name, None, type=socket.SOCK_STREAM)
    except OSError:
        return ()
    return tuple(dict.fromkeys(str(info[4][0]) for info in infos))


def _is_local(host: str) -> bool | None:
    """Whether a host is this one; None if its name does not resolve."""
    if is_loopback(host):
        return True
    found = _resolved(host)
    return is_own(found) if found else None


def is_own(addresses: Iterable[str]) -> bool:
    """Whether any of these addresses is one of this host's."""
    own = {address for _, address in _interfaces()}
    return any(is_loopback(one) or one in own for one in addresses)


def _loopback_problem() -> str:
    try:
        with socket.create_server(("127.0.0.1", 0)) as server:
            address = server.getsockname()
            with socket.create_connection(address, timeout=_LOOPBACK_LIMIT_S):
                return ""
    except OSError as error:
        return error.strerror or str(error)


def _has_ipv6() -> bool:
    try:
        with socket.socket(socket.AF_INET6, socket.SOCK_STREAM) as sock:
            sock.bind(("::1", 0))
    except OSError:
        return False
    return True


def _interfaces() -> tuple[tuple[str, str], ...]:
    import psutil

    families = (socket.AF_INET, socket.AF_INET6)
    return tuple(
        (name, entry.address)
        for name, entries in sorted(psutil.net_if_addrs().items())
        for entry in entries
        if entry.family in families and "%" not in entry.address and not is_loopback(entry.address)
    )


def look_at_listeners() -> list[Listener]:
    """All sockets of this host that listen for TCP connections."""
    import psutil

    found = []
    for entry in psutil.net_connections(kind="tcp"):
        if entry.status == psutil.CONN_LISTEN and entry.laddr:
            program = _program(entry.pid) if entry.pid else ""
            found.append(Listener(entry.laddr.ip, entry.laddr.port, entry.pid or None, program))
    return found


def _program(pid: int) -> str:
    import psutil

    try:
        command = psutil.Process(pid).cmdline()
    except psutil.Error:
        return ""
    words = [command[0].rpartition("/")[2], *command[1:]] if command else []
    text = " ".join(words)
    return text if len(text) <= _SHOWN_COMMAND else f"{text[:_SHOWN_COMMAND]}…"
