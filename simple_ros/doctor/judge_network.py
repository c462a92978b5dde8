"""Can nodes and tools of this host reach the Master and each other, as far as the host goes?"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher

from simple_ros.doctor.findings import Finding, error, ok, warning

__all__ = [
    "DEFAULT_PORT",
    "MASTER_VARIABLE",
    "Environment",
    "Listener",
    "Network",
    "judge_environment",
    "judge_network",
    "judge_ports",
]

MASTER_VARIABLE = "SIMPLE_ROS_MASTER"
_SLOW_LOOKUP_S = 0.5
_NODE_PORTS = range(60000, 61001)
DEFAULT_PORT = 50051
_FOXGLOVE_PORT = 8765
_CPP_PORTS = {
    50052: ("master", "the C++ Master"),
    50053: ("foxglove", "the C++ foxglove_bridge"),
    60002: ("rostopic", "C++ rostopic"),
}


@dataclass(frozen=True, slots=True)
class Environment:
    """Environment variables that matter; values of proxies are not kept, they may hold passwords.

    Attributes:
        master: Where the Master is looked for.
        master_from: Who says so: ``--master``, ``SIMPLE_ROS_MASTER`` or ``default``.
        master_problem: Why it is no address; empty if it is one.
        names: Names of all variables.
        proxies: Names of those that set a proxy gRPC would use.
        is_exempt: Whether ``no_grpc_proxy`` or ``no_proxy`` names the Master's host.
    """

    master: str
    master_from: str
    master_problem: str = ""
    names: tuple[str, ...] = ()
    proxies: tuple[str, ...] = ()
    is_exempt: bool = False


def judge_environment(found: Environment) -> list[Finding]:
    """All findings about environment variables."""
    return [_master_setting(found), *_misspelt(found.names), *_proxies(found)]


def _master_setting(found: Environment) -> Finding:
    if found.master_problem:
        return error(
            "master address",
            f"{found.master_from}: {found.master_problem}",
            "for example 'export SIMPLE_ROS_MASTER=robot.local:50051'",
        )
    return ok("master address", f"{found.master} ({found.master_from})")


def _misspelt(names: Sequence[str]) -> Iterator[Finding]:
    for name in names:
        likeness = SequenceMatcher(None, name, MASTER_VARIABLE).ratio()
        if name != MASTER_VARIABLE and likeness > 0.85:
            yield warning(
                "environment",
                f"nothing reads {name}",
                f"if it shall say where the Master is, its name is {MASTER_VARIABLE}",
            )
    if "ROS_MASTER_URI" in names and MASTER_VARIABLE not in names:
        yield ok("environment", f"ROS_MASTER_URI is ROS 1's; simple_ros reads {MASTER_VARIABLE}")


def _proxies(found: Environment) -> Iterator[Finding]:
    listed = ", ".join(found.proxies)
    if not found.proxies:
        yield ok("proxy", "none is set")
    elif found.is_exempt:
        yield ok("proxy", f"{listed} is set, and the Master's host is exempt")
    else:
        yield warning(
            "proxy",
            f"{listed} is set: nodes and tools of ours ignore it, but C++ simple_ros sends its calls "
            "to the Master through that proxy",
            f"export no_grpc_proxy={_host(found.master)}",
        )


def _host(address: str) -> str:
    return address.rpartition(":")[0]


@dataclass(frozen=True, slots=True)
class Network:
    """What was found out about names and addresses.

    Attributes:
        hostname: Of this host.
        host_addresses: What it resolves to; empty if it does not.
        lookup_s: How long that took, in seconds.
        localhost_addresses: What ``localhost`` resolves to.
        loopback_problem: Why a connection over 127.0.0.1 failed; empty if it stood.
        has_ipv6: Whether a socket can listen on ``::1``.
        interfaces: Name and address of each interface but loopback.
        own_address: The IPv4 address that a node here would show to its peers; empty if unknown.
        is_master_local: Whether the Master's host is this one; None if unknown.
    """

    hostname: str
    host_addresses: tuple[str, ...]
    lookup_s: float
    localhost_addresses: tuple[str, ...]
    loopback_problem: str
    has_ipv6: bool
    interfaces: tuple[tuple[str, str], ...]
    own_address: str
    is_master_local: bool | None


def judge_network(found: Network) -> list[Finding]:
    """All findings about names and addresses."""
    return [_hostname(found), _loopback(found), *_addresses(found)]


def _hostname(found: Network) -> Finding:
    name = found.hostname
    if not found.host_addresses:
        return warning(
            "host name",
            f"{name!r}, the name of this host, does not resolve; some programs wait for that",
            f"add the line '127.0.1.1 {name}' to /etc/hosts",
        )
    text = f"{name!r} is {', '.join(found.host_addresses)}"
    if found.lookup_s > _SLOW_LOOKUP_S:
        return warning(
            "host name",
            f"{text}, but finding out took {found.lookup_s:.1f} s",
            f"add the line '127.0.1.1 {name}' to /etc/hosts, or look at /etc/resolv.conf",
        )
    return ok("host name", text)


def _loopback(found: Network) -> Finding:
    if found.loopback_problem:
        return error(
            "loopback",
            f"no connection over 127.0.0.1: {found.loopback_problem}",
            "'ip link set lo up'; look for a firewall rule on lo",
        )
    if "127.0.0.1" not in found.localhost_addresses:
        listed = ", ".join(found.localhost_addresses) or "nothing"
        return error(
            "loopback",
            f"'localhost' is {listed}, not 127.0.0.1; the Master listens there",
            "add the line '127.0.0.1 localhost' to /etc/hosts",
        )
    return ok(
        "loopback", f"connections stand; 'localhost' is {', '.join(found.localhost_addresses)}"
    )


def _addresses(found: Network) -> Iterator[Finding]:
    own = found.own_address
    listed = ", ".join(f"{address} ({name})" for name, address in found.interfaces) or "none"
    if not own:
        yield warning(
            "own address", f"which address nodes here would show cannot be told; has {listed}"
        )
    elif own.startswith("127.") and found.is_master_local is False:
        yield error(
            "own address",
            f"nodes here would show {own} to peers on other hosts: there is no route to the Master",
            "connect this host to the Master's network",
        )
    elif own.startswith("127."):
        yield ok("own address", f"nodes here show {own}: the Master is on this host")
    else:
        yield ok("own address", f"nodes here show {own}, by the route to the Master")
    yield ok("interfaces", listed)
    yield ok("IPv6", "available" if found.has_ipv6 else "not available; nothing needs it")


@dataclass(frozen=True, slots=True)
class Listener:
    """A socket that listens for TCP connections.

    Attributes:
        ip: Where it is bound.
        port: Where it is bound.
        pid: Whose it is; None if that is not told to us.
        program: How that process was started; empty if unknown.
    """

    ip: str
    port: int
    pid: int | None = None
    program: str = ""

    def __str__(self) -> str:
        if self.pid is None:
            return "a program of another user"
        return f"{self.program or 'a process'} (pid {self.pid})"


def judge_ports(listeners: Sequence[Listener], master_port: int = DEFAULT_PORT) -> list[Finding]:
    """All findings about ports of this host.

    Args:
        listeners: All that listen.
        master_port: Where a Master of this host is looked for.
    """
    by_port = defaultdict(list)
    for listener in listeners:
        by_port[listener.port].append(listener)
    findings = [_master_port(port, by_port[port]) for port in sorted({DEFAULT_PORT, master_port})]
    findings.append(
        ok(f"port {_FOXGLOVE_PORT}", f"{_users(by_port[_FOXGLOVE_PORT])} (Foxglove bridges use it)")
    )
    for port, (owner, who) in _CPP_PORTS.items():
        strangers = [one for one in by_port[port] if one.pid and owner not in one.program]
        if strangers:
            findings.append(
                warning(
                    f"port {port}",
                    f"{_users(strangers)}; {who} aborts without it",
                    f"end that program before using {who}; nodes of ours never take this port",
                )
            )
    findings.append(_node_ports([one for one in listeners if one.port in _NODE_PORTS]))
    return findings


def _users(listeners: Sequence[Listener]) -> str:
    return f"used by {', '.join(sorted(set(map(str, listeners))))}" if listeners else "free"


def _master_port(port: int, listeners: Sequence[Listener]) -> Finding:
    check = f"port {port}"
    pids = {listener.pid for listener in listeners if listener.pid is not None}
    if len(pids) > 1:
        return error(
            check,
            f"{len(pids)} programs listen on it: {', '.join(sorted(set(map(str, listeners))))}; each call "
            "goes to either, so nodes do not find each other",
            f"end all but one, for example 'kill {max(pids)}'",
        )
    places = [listener.ip for listener in listeners]
    if not pids and len(set(places)) < len(places):
        return warning(
            check,
            "several sockets of another user listen on it: perhaps two Masters",
            "run 'sudo simple-ros doctor' to see whose they are",
        )
    if not listeners:
        return ok(check, "free: no Master runs on this host there")
    here = all(place.startswith("127.") or place == "::1" for place in places)
    reach = ", reachable from this host only" if here else ""
    return ok(check, f"{_users(listeners)}{reach}")


def _node_ports(listeners: Sequence[Listener]) -> Finding:
    first, last = _NODE_PORTS[0], _NODE_PORTS[-1]
    check = f"ports {first}-{last}"
    used = len({listener.port for listener in listeners})
    if used > 0.9 * len(_NODE_PORTS):
        return warning(
            check,
            f"{used} are in use; C++ nodes need a free one",
            "end programs that listen there; 'ss -ltnp' lists them",
        )
    shown = sorted({f"{one.port} {one}" for one in listeners})
    more = f" and {len(shown) - 4} more" if len(shown) > 4 else ""
    listed = f": {', '.join(shown[:4])}{more}" if shown else ""
    return ok(check, f"{used} in use{listed} (C++ nodes listen there)")
