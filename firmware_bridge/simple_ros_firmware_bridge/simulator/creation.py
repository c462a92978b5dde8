"""The submessages by which a simulated board creates its topics, readers and writers."""

from __future__ import annotations

import struct
from dataclasses import dataclass

__all__ = ["Topic", "creations"]


@dataclass(frozen=True)
class Topic:
    """A topic that a board publishes or subscribes.

    Attributes:
        index: Its number on the board.
        name: With a slash, as in ``rclc_publisher_init``.
        type_name: ``sensor_msgs/Imu``.
        is_published: Else it is subscribed.
        is_reliable: How it is sent.
        by_xml: Whether it is created by XML instead of BIN.
    """

    index: int
    name: str
    type_name: str
    is_published: bool = True
    is_reliable: bool = True
    by_xml: bool = False

    def id(self, kind: int) -> bytes:
        """The id of its object of a kind."""
        return struct.pack(">H", self.index << 4 | kind)

    @property
    def endpoint_id(self) -> bytes:
        """The id of its writer or reader."""
        return self.id(5 if self.is_published else 6)

    @property
    def dds_type(self) -> str:
        """``sensor_msgs::msg::dds_::Imu_``."""
        package, _, name = self.type_name.partition("/")
        return f"{package}::msg::dds_::{name}_"


def _text(value: str) -> bytes:
    data = value.encode() + b"\0"
    return struct.pack("<I", len(data)) + data


def _create(request: int, object_id: bytes, form: int, body: bytes, parent: bytes) -> bytes:
    payload = struct.pack(">H", request) + object_id + bytes((object_id[1] & 15, form, 0, 0))
    payload += struct.pack("<I", len(body)) + body
    payload += b"\0" * (len(payload) % 2) if len(parent) == 2 and object_id[1] & 15 == 1 else b""
    payload += parent
    head = struct.pack("<BBH", 1, 0x07, len(payload))
    return head + payload + bytes(-len(payload) % 4)


def _xml(topic: Topic) -> tuple[bytes, bytes]:
    named = f"<name>rt{topic.name}</name><dataType>{topic.dds_type}</dataType>"
    kind = "RELIABLE" if topic.is_reliable else "BEST_EFFORT"
    side = "data_writer" if topic.is_published else "data_reader"
    end = (
        f"<dds><{side}><topic><kind>NO_KEY</kind>{named}</topic><qos><reliability><kind>{kind}</kind>"
        f"</reliability></qos></{side}></dds>"
    )
    return _text(f"<dds><topic>{named}</topic></dds>")[4:], _text(end)[4:]


def _bin(topic: Topic) -> tuple[bytes, bytes]:
    name = _text("rt" + topic.name)
    body = name + b"\0\x01"
    body += bytes(-len(body) % 4) + _text(topic.dds_type)
    flags = 0x02 | (0x01 if topic.is_reliable else 0)
    end = (
        topic.id(2) + b"\x01" + b"\0" + struct.pack("<H", flags) + b"\x01\0" + struct.pack("<H", 10)
    )
    return body, end + b"\0\0\0\0"


def creations(topics: list[Topic]) -> list[bytes]:
    """Everything in the order in which rclc makes it; subscriptions also ask for their samples."""
    made = [_create(1, b"\x00\x11", 3, b"\0\x01\0\0" + _text("pico"), b"\0\0")]
    request = 1
    for topic in topics:
        body, end = _xml(topic) if topic.by_xml else _bin(topic)
        form = 2 if topic.by_xml else 3
        middle, last = (3, 5) if topic.is_published else (4, 6)
        made += [
            _create(request + 1, topic.id(2), form, body, b"\x00\x11"),
            _create(request + 2, topic.id(middle), 3, b"\0\0", b"\x00\x11"),
            _create(request + 3, topic.id(last), form, end, topic.id(middle)),
        ]
        request += 4
        if not topic.is_published:
            stream = 0x80 if topic.is_reliable else 0x01
            wanted = struct.pack(">H", request) + topic.id(6) + bytes((stream, 0, 0, 1))
            wanted += struct.pack("<HHHH", 0xFFFF, 0, 0, 0)
            made.append(struct.pack("<BBH", 8, 1, len(wanted)) + wanted)
    return made
