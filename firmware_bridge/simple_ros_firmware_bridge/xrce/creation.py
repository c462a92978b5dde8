"""What a CREATE asks for, in any of the three ways a client may write it: BIN, XML or REF."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from html import unescape

from simple_ros_firmware_bridge.xrce.wire import Kind, MalformedMessage

__all__ = ["Creation", "ObjectId", "Reader", "parse_creation"]

_REF, _XML, _BIN = 1, 2, 3
_RELIABLE = 0x01
_TRANSIENT = 0x08 | 0x10 | 0x20
_MAX_STRING = 1024


class ObjectId(bytes):
    """Two bytes: an index of 12 bits, a kind of 4."""

    @property
    def kind(self) -> int:
        """The low 4 bits, see `Kind`."""
        return self[1] & 0x0F

    def __repr__(self) -> str:
        return self.hex()


@dataclass(frozen=True)
class Creation:
    """An object to be made.

    Attributes:
        object_id: Its id.
        kind: Its kind.
        name: Of a participant, topic or service, as the client wrote it (``rt/odom``); of a reader or
            writer that names its topic instead of pointing to it, that topic.
        type_name: Of a topic: ``nav_msgs::msg::dds_::Odometry_``.
        topic: Of a reader or writer: the id of its topic.
        reference: Name of a profile, if it was made by REF.
        reliable: Of a reader or writer.
        transient: Of a writer: keeps messages for late readers.
        reply_type: Of a requester or replier.
    """

    object_id: ObjectId
    kind: int
    name: str = ""
    type_name: str = ""
    topic: ObjectId | None = None
    reference: str = ""
    reliable: bool = True
    transient: bool = False
    reply_type: str = ""


class Reader:
    """Reads XRCE's own structures, aligned from their first byte.

    Args:
        data: The bytes.
        order: Byte order, ``<`` or ``>``.
    """

    def __init__(self, data: bytes, order: str) -> None:
        self._data = data
        self._order = order
        self.position = 0

    def raw(self, count: int) -> bytes:
        """So many bytes.

        Raises:
            MalformedMessage: There are fewer.
        """
        end = self.position + count
        if end > len(self._data):
            raise MalformedMessage(f"{count} bytes at {self.position} of {len(self._data)}")
        piece = self._data[self.position : end]
        self.position = end
        return piece

    def number(self, code: str) -> int:
        """An integer of a `struct` code."""
        size = struct.calcsize("=" + code)
        self.position += -self.position % size
        return int(struct.unpack(self._order + code, self.raw(size))[0])

    @property
    def has_more(self) -> bool:
        """Whether anything is left."""
        return self.position < len(self._data)

    def flag(self) -> bool:
        """A bool of one byte."""
        return self.raw(1) != b"\0"

    def text(self) -> str:
        """A string with its length before it; a NUL at its end is optional."""
        size = self.number("I")
        if size > _MAX_STRING:
            raise MalformedMessage(f"a string of {size} bytes")
        return self.raw(size).rstrip(b"\0").decode("utf-8", "replace")

    def optional_text(self) -> str:
        """A string behind a flag."""
        return self.text() if self.flag() else ""


def parse_creation(payload: bytes, order: str) -> Creation:
    """The object that the payload of a CREATE describes, behind its request id.

    Raises:
        MalformedMessage: The payload makes no sense.
    """
    outer = Reader(payload, order)
    outer.raw(2)
    object_id = ObjectId(outer.raw(2))
    kind, form = outer.raw(1)[0], outer.raw(1)[0]
    outer.raw(2)
    size = outer.number("I")
    body = outer.raw(size)
    if form == _BIN:
        return _from_bin(object_id, kind, Reader(body, order))
    text = body.rstrip(b"\0").decode("utf-8", "replace")
    if form == _XML:
        return _from_xml(object_id, kind, text)
    if form == _REF:
        return Creation(object_id, kind, reference=text)
    raise MalformedMessage(f"an object in form {form}")


def _from_bin(object_id: ObjectId, kind: int, body: Reader) -> Creation:
    match kind:
        case Kind.PARTICIPANT:
            body.flag()
            return Creation(object_id, kind, body.optional_text())
        case Kind.TOPIC:
            name = body.text()
            if body.flag():
                body.text()
            return Creation(object_id, kind, name, body.optional_text())
        case Kind.DATAWRITER | Kind.DATAREADER:
            topic = ObjectId(body.raw(2))
            qos = body.number("H") if body.flag() else _RELIABLE
            return Creation(
                object_id,
                kind,
                topic=topic,
                reliable=bool(qos & _RELIABLE),
                transient=bool(qos & _TRANSIENT),
            )
        case Kind.REQUESTER | Kind.REPLIER:
            name, request, reply = body.text(), body.text(), body.text()
            requests = body.optional_text() if body.has_more else ""
            name = name or requests.removeprefix("rq/").removesuffix("Request")
            return Creation(object_id, kind, name, request, reply_type=reply)
        case _:
            return Creation(object_id, kind)


def _tag(text: str, name: str) -> str:
    """Content of the first element of that name, or empty."""
    found = re.search(rf"<{name}>\s*([^<]*?)\s*</{name}>", text)
    return unescape(found[1]) if found else ""


def _from_xml(object_id: ObjectId, kind: int, text: str) -> Creation:
    name, type_name = _tag(text, "name"), _tag(text, "dataType")
    attributes = dict(re.findall(r'(\w+)="([^"]*)"', text))
    return Creation(
        object_id,
        kind,
        name or attributes.get("service_name", ""),
        type_name or attributes.get("request_type", ""),
        reliable="BEST_EFFORT" not in text,
        transient="TRANSIENT" in text or "PERSISTENT" in text,
        reply_type=attributes.get("reply_type", ""),
    )
