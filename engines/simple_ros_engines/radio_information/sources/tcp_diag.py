"""What the kernel says about TCP connections: messages of inet_diag(7). Pure.

One request asks for all established connections; each answer holds ``struct inet_diag_msg`` and, as an
attribute, ``struct tcp_info`` of linux/tcp.h.
"""

from __future__ import annotations

import ipaddress
import struct
from collections.abc import Iterator
from dataclasses import dataclass

__all__ = ["TcpConnection", "parse_answers", "request"]

_SOCK_DIAG_BY_FAMILY = 20
_NLMSG_ERROR, _NLMSG_DONE = 2, 3
_REQUEST_DUMP = 0x301
_TCP = 6
_ESTABLISHED = 1 << 1
_INFO = 2
_HEADER = struct.Struct("=IHHII")
_DIAG = struct.Struct("=BBBB")
_PORTS = struct.Struct(">HH")
_QUEUES = struct.Struct("=II")
_DIAG_SIZE = 72
_INFO_SIZE = 168


@dataclass(frozen=True, slots=True)
class TcpConnection:
    """One established connection.

    Attributes:
        local_port: Of this host.
        peer: Address of the other host.
        peer_port: Of the other host.
        rtt_ms: Smoothed round trip.
        rtt_var_ms: Its mean deviation.
        min_rtt_ms: Least round trip.
        delivery_bps: What the peer acknowledged lately; 0 while unknown.
        retransmitted: Segments sent again since the start.
        sent: Segments with data sent since the start.
        waiting_bytes: Sent or to be sent, not acknowledged.
    """

    local_port: int
    peer: str
    peer_port: int
    rtt_ms: float
    rtt_var_ms: float
    min_rtt_ms: float
    delivery_bps: float
    retransmitted: int
    sent: int
    waiting_bytes: int


def request(family: int) -> bytes:
    """The question for all established TCP connections of an address family (2 IPv4, 10 IPv6)."""
    body = struct.pack("=BBBBI", family, _TCP, 1 << (_INFO - 1), 0, _ESTABLISHED) + bytes(48)
    return _HEADER.pack(16 + len(body), _SOCK_DIAG_BY_FAMILY, _REQUEST_DUMP, 1, 0) + body


def parse_answers(data: bytes) -> tuple[list[TcpConnection], bool]:
    """The connections of what one read brought, and whether that was the end."""
    found: list[TcpConnection] = []
    for kind, body in _messages(data):
        if kind in (_NLMSG_DONE, _NLMSG_ERROR):
            return found, True
        connection = _connection(body) if kind == _SOCK_DIAG_BY_FAMILY else None
        if connection is not None:
            found.append(connection)
    return found, False


def _messages(data: bytes) -> Iterator[tuple[int, bytes]]:
    at = 0
    while at + 16 <= len(data):
        length, kind, _, _, _ = _HEADER.unpack_from(data, at)
        if length < 16 or at + length > len(data):
            return
        yield kind, data[at + 16 : at + length]
        at += (length + 3) & ~3


def _connection(body: bytes) -> TcpConnection | None:
    if len(body) < _DIAG_SIZE:
        return None
    family = _DIAG.unpack_from(body)[0]
    local_port, peer_port = _PORTS.unpack_from(body, 4)
    raw = body[24 : 24 + (4 if family == 2 else 16)]
    _, write_queue = _QUEUES.unpack_from(body, 56)
    info = _attribute(body[_DIAG_SIZE:], _INFO)
    if info is None or len(info) < _INFO_SIZE:
        return None
    words = struct.unpack_from("=24I", info, 8)
    min_rtt = struct.unpack_from("=I", info, 148)[0]
    sent = struct.unpack_from("=I", info, 156)[0]
    rate = struct.unpack_from("=Q", info, 160)[0]
    address = ipaddress.ip_address(raw)
    mapped = getattr(address, "ipv4_mapped", None)
    return TcpConnection(
        local_port,
        str(mapped or address),
        peer_port,
        words[15] / 1000,
        words[16] / 1000,
        0.0 if min_rtt == 0xFFFFFFFF else min_rtt / 1000,
        8.0 * rate,
        words[23],
        sent,
        write_queue,
    )


def _attribute(data: bytes, wanted: int) -> bytes | None:
    at = 0
    while at + 4 <= len(data):
        length, kind = struct.unpack_from("=HH", data, at)
        if length < 4:
            return None
        if kind == wanted:
            return data[at + 4 : at + length]
        at += (length + 3) & ~3
    return None
