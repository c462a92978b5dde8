"""Messages of DDS-XRCE as bytes: a header, then submessages, each at a multiple of 4."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from enum import IntEnum
from typing import NamedTuple

from simple_ros.errors import SimpleRosError

__all__ = [
    "BEST_EFFORT",
    "LAST_FRAGMENT",
    "LITTLE",
    "NO_STREAM",
    "RELIABLE",
    "Header",
    "Kind",
    "MalformedMessage",
    "Status",
    "Submessage",
    "SubmessageId",
    "acknack",
    "heartbeat",
    "is_reliable",
    "message",
    "parse_header",
    "parse_submessages",
    "submessage",
]

NO_STREAM = 0x00
BEST_EFFORT = 0x01
RELIABLE = 0x80
LITTLE = 0x01
LAST_FRAGMENT = 0x02
KEYLESS_FROM = 0x80
"""Sessions from this number up carry no client key in their headers."""

_SUBHEADER = 4


class MalformedMessage(SimpleRosError, ValueError):
    """Bytes are no XRCE message.

    Attributes:
        reason: What was found.
    """

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(f"no XRCE message: {reason}")


class SubmessageId(IntEnum):
    """What a submessage is."""

    CREATE_CLIENT = 0
    CREATE = 1
    GET_INFO = 2
    DELETE = 3
    STATUS_AGENT = 4
    STATUS = 5
    INFO = 6
    WRITE_DATA = 7
    READ_DATA = 8
    DATA = 9
    ACKNACK = 10
    HEARTBEAT = 11
    RESET = 12
    FRAGMENT = 13
    TIMESTAMP = 14
    TIMESTAMP_REPLY = 15


class Status(IntEnum):
    """The answers to a request."""

    OK = 0x00
    OK_MATCHED = 0x01
    DDS_ERROR = 0x80
    EXISTS = 0x82
    UNKNOWN_REFERENCE = 0x84
    INVALID_DATA = 0x85
    INCOMPATIBLE = 0x86
    RESOURCES = 0x87


class Kind(IntEnum):
    """Kinds of objects: the low 4 bits of an object id."""

    PARTICIPANT = 1
    TOPIC = 2
    PUBLISHER = 3
    SUBSCRIBER = 4
    DATAWRITER = 5
    DATAREADER = 6
    REQUESTER = 7
    REPLIER = 8


class Header(NamedTuple):
    """The begin of a message.

    Attributes:
        session: Session id; 0x80 and 0x00 outside of any session.
        stream: 0 none, 1..127 best effort, from 128 reliable.
        sequence: Number in the stream.
        key: Client key, empty from session 0x80 up.
        size: Bytes of the header.
    """

    session: int
    stream: int
    sequence: int
    key: bytes
    size: int


class Submessage(NamedTuple):
    """One submessage.

    Attributes:
        id: See `SubmessageId`; unknown numbers may occur.
        flags: Bit 0: little endian.
        payload: Its content.
    """

    id: int
    flags: int
    payload: bytes

    @property
    def order(self) -> str:
        """Byte order of its numbers, as `struct` writes it."""
        return "<" if self.flags & LITTLE else ">"

    @property
    def is_last_fragment(self) -> bool:
        """Of a fragment: whether it completes."""
        return bool(self.flags & LAST_FRAGMENT)


def is_reliable(stream: int) -> bool:
    """Whether a stream is one of the reliable ones."""
    return stream >= RELIABLE


def parse_header(data: bytes) -> Header:
    """The header of a message.

    Raises:
        MalformedMessage: It is shorter than a header.
    """
    size = 4 if data[:1] >= b"\x80" else 8
    if len(data) < size:
        raise MalformedMessage(f"{len(data)} bytes")
    session, stream, sequence = struct.unpack_from("<BBH", data)
    return Header(session, stream, sequence, data[4:size], size)


def parse_submessages(data: bytes, start: int) -> Iterator[Submessage]:
    """The submessages from ``start`` on. Padding at the end is skipped.

    Raises:
        MalformedMessage: One is cut.
    """
    position = start
    while position + _SUBHEADER <= len(data):
        kind, flags = data[position], data[position + 1]
        order = "little" if flags & LITTLE else "big"
        length = int.from_bytes(data[position + 2 : position + 4], order)  # type: ignore[arg-type]
        position += _SUBHEADER
        if length == 0 and kind in (SubmessageId.WRITE_DATA, SubmessageId.FRAGMENT):
            length = len(data) - position  # "to the end", for what is longer than 64 KiB
        end = position + length
        if end > len(data):
            raise MalformedMessage(f"submessage {kind} of {length} bytes is cut")
        yield Submessage(kind, flags, data[position:end])
        position = (end + 3) & ~3


def submessage(kind: SubmessageId, payload: bytes, flags: int = LITTLE) -> bytes:
    """The bytes of a submessage, without padding behind it."""
    return struct.pack("<BBH", kind, flags, len(payload)) + payload


def message(session: int, stream: int, sequence: int, key: bytes, body: bytes) -> bytes:
    """A message of submessages that are already bytes."""
    head = struct.pack("<BBH", session, stream, sequence)
    return head + (key if session < KEYLESS_FROM else b"") + body


def acknack(first: int, missing: int, stream: int) -> bytes:
    """ACKNACK: everything before ``first`` has come, and bit i of ``missing`` asks for ``first + i``."""
    payload = struct.pack("<H", first) + missing.to_bytes(2, "big") + bytes((stream,))
    return submessage(SubmessageId.ACKNACK, payload)


def heartbeat(first: int, last: int, stream: int) -> bytes:
    """HEARTBEAT: ``first`` to ``last`` can still be sent again."""
    return submessage(SubmessageId.HEARTBEAT, struct.pack("<HHB", first, last, stream))
