"""Code points (DSCP) that peers on this host have set on their connections, as the kernel tells them.

A receiver of TCP cannot see them, but inet_diag(7) can: it tells every socket's type of service to anybody.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator

__all__ = ["code_points", "parse_code_points", "request"]

_HEADER = struct.Struct("=IHHII")
_PORTS = struct.Struct(">HH")
_SOCK_DIAG_BY_FAMILY = 20
_NLMSG_ERROR, _NLMSG_DONE = 2, 3
_REQUEST_DUMP = 0x301
_ESTABLISHED = 1 << 1
_TOS, _TCLASS = 5, 6
_DIAG_BYTES = 72
_NETLINK_SOCK_DIAG = 4


def request(family: int) -> bytes:
    """The question for the type of service of all established TCP connections of a family."""
    wanted = 1 << ((_TOS if family == socket.AF_INET else _TCLASS) - 1)
    body = struct.pack("=BBBBI", family, socket.IPPROTO_TCP, wanted, 0, _ESTABLISHED) + bytes(48)
    return _HEADER.pack(16 + len(body), _SOCK_DIAG_BY_FAMILY, _REQUEST_DUMP, 1, 0) + body


def parse_code_points(data: bytes) -> tuple[dict[tuple[int, int], int], bool]:
    """By local and remote port: the code point; and whether this was the end of the answers."""
    found: dict[tuple[int, int], int] = {}
    for kind, body in _messages(data):
        if kind in (_NLMSG_DONE, _NLMSG_ERROR):
            return found, True
        if kind == _SOCK_DIAG_BY_FAMILY and len(body) >= _DIAG_BYTES:
            for name, value in _attributes(body[_DIAG_BYTES:]):
                if name in (_TOS, _TCLASS) and value:
                    found[_PORTS.unpack_from(body, 4)] = value[0] >> 2
    return found, False


def _messages(data: bytes) -> Iterator[tuple[int, bytes]]:
    at = 0
    while at + 16 <= len(data):
        length, kind, _, _, _ = _HEADER.unpack_from(data, at)
        if length < 16 or at + length > len(data):
            return
        yield kind, data[at + 16 : at + length]
        at += (length + 3) & ~3


def _attributes(data: bytes) -> Iterator[tuple[int, bytes]]:
    at = 0
    while at + 4 <= len(data):
        length, kind = struct.unpack_from("=HH", data, at)
        if length < 4:
            return
        yield kind, data[at + 4 : at + length]
        at += (length + 3) & ~3


def code_points() -> dict[tuple[int, int], int]:
    """Of all TCP connections of this host, by local and remote port.

    Raises:
        OSError: The kernel does not tell.
    """
    found: dict[tuple[int, int], int] = {}
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, _NETLINK_SOCK_DIAG) as netlink:
        netlink.settimeout(1.0)
        for family in (socket.AF_INET, socket.AF_INET6):
            netlink.send(request(family))
            done = False
            while not done:
                more, done = parse_code_points(netlink.recv(1 << 18))
                found |= more
    return found
