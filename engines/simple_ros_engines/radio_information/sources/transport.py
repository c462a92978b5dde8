"""Round trip, rate and loss of this host's TCP connections, as the kernel measures them on live traffic.

Needs no hardware and no rights: it asks the kernel (inet_diag, Linux) about every established connection,
so it sees the topic links of all nodes on this host. The link's key is the address of the other host. Round
trips of heartbeats come on top.
"""

from __future__ import annotations

import asyncio
import ipaddress
import socket
import time
from collections.abc import Iterable, Mapping, Sequence
from typing import ClassVar

from simple_ros.node import NodeHandle
from simple_ros_engines.heartbeat import HeartbeatAsker
from simple_ros_engines.radio_information.record import LinkRecord, record
from simple_ros_engines.radio_information.sources.base import Emit, MetricsSource, SourceDown
from simple_ros_engines.radio_information.sources.tcp_diag import (
    TcpConnection,
    parse_answers,
    request,
)

__all__ = ["TransportSource", "link_records"]

_NETLINK_SOCK_DIAG = 4
_Counts = dict[tuple[str, int, int], tuple[int, int]]


class TransportSource(MetricsSource):
    """Connections to other hosts, one link for each host.

    Args:
        period_s: Between looks.
        loopback: Whether connections within this host count.
        ports: Only connections of which either side has one of these ports; empty for all.
        echo: Whether to time heartbeats, too, which other radio information engines send back.
    """

    may_be_silent = True

    summary: ClassVar[str] = "TCP connections of this host: round trip, rate, loss (Linux)"

    def __init__(
        self,
        period_s: float = 0.5,
        loopback: bool = False,
        ports: Sequence[int] = (),
        echo: bool = True,
    ) -> None:
        self.period_s = period_s
        self._loopback = loopback
        self._ports = frozenset(ports)
        self._before: _Counts = {}
        self._asker = HeartbeatAsker(period_s) if echo else None

    async def attach(self, node: NodeHandle) -> None:
        """Begin to time heartbeats."""
        if self._asker is not None:
            await self._asker.attach(node)

    async def run(self, emit: Emit) -> None:
        """Give a record of each host at each look.

        Raises:
            SourceDown: The kernel does not answer.
        """
        while True:
            try:
                connections = await asyncio.to_thread(_ask_kernel)
            except (OSError, AttributeError) as error:
                raise SourceDown(f"inet_diag does not answer: {error}") from error
            kept = [item for item in connections if self._counts(item)]
            echoes = self._asker.take() if self._asker is not None else {}
            heard = {host: taken for host, taken in echoes.items() if self._is_meant(host)}
            records, self._before = link_records(kept, self._before, time.time_ns(), heard)
            for item in records:
                emit(item)
            await asyncio.sleep(self.period_s)

    def _counts(self, item: TcpConnection) -> bool:
        if not self._is_meant(item.peer):
            return False
        return not self._ports or bool(self._ports & {item.local_port, item.peer_port})

    def _is_meant(self, host: str) -> bool:
        try:
            return self._loopback or not ipaddress.ip_address(host).is_loopback
        except ValueError:
            return False


def link_records(
    connections: Iterable[TcpConnection],
    before: _Counts,
    now_ns: int,
    echoes: Mapping[str, float] | None = None,
) -> tuple[list[LinkRecord], _Counts]:
    """A record of each peer, and the counters to compare with the next time.

    The round trip is that of the connection that sent most since; loss is what had to be sent again of what
    was sent; rates and what waits are sums. A host of which only heartbeats (``echoes``, ms by host) are known
    has their round trip.
    """
    echoes = echoes or {}
    by_peer: dict[str, list[TcpConnection]] = {}
    for item in connections:
        by_peer.setdefault(item.peer, []).append(item)
    counts: _Counts = {}
    records = []
    for peer, items in by_peer.items():
        again = sent = 0
        busiest, most = items[0], -1
        for item in items:
            key = (peer, item.local_port, item.peer_port)
            counts[key] = (item.retransmitted, item.sent)
            old = before.get(key, counts[key])
            again += max(0, item.retransmitted - old[0])
            fresh = max(0, item.sent - old[1])
            sent += fresh
            if fresh > most:
                busiest, most = item, fresh
        loss = again / sent if sent else None
        records.append(_record(peer, items, busiest, loss, now_ns, echoes.get(peer)))
    for host in echoes.keys() - by_peer.keys():
        values = {"rtt_ms": echoes[host], "echo_rtt_ms": echoes[host]}
        records.append(record(host, now_ns, "transport", values, derived=("rtt_ms",)))
    return records, counts


def _record(
    peer: str,
    items: list[TcpConnection],
    busiest: TcpConnection,
    loss: float | None,
    now_ns: int,
    echo_ms: float | None,
) -> LinkRecord:
    rate = sum(item.delivery_bps for item in items)
    values = {
        "rtt_ms": busiest.rtt_ms,
        "echo_rtt_ms": echo_ms,
        "rtt_var_ms": busiest.rtt_var_ms,
        "min_rtt_ms": min(item.min_rtt_ms for item in items),
        "delivery_bps": rate or None,
        "loss": None if loss is None else min(1.0, loss),
        "buffer_bytes": float(sum(item.waiting_bytes for item in items)),
    }
    return record(peer, now_ns, "transport", values, derived=("loss",))


def _ask_kernel() -> list[TcpConnection]:
    found: list[TcpConnection] = []
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, _NETLINK_SOCK_DIAG) as netlink:
        netlink.settimeout(1.0)
        for family in (socket.AF_INET, socket.AF_INET6):
            netlink.send(request(family))
            done = False
            while not done:
                more, done = parse_answers(netlink.recv(1 << 18))
                found += more
    return found
