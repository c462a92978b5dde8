"""Topics and messages as a bag holds them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import DecodeError, Message
from mcap.records import Channel, Schema

from simple_ros.errors import UnknownMessageType
from simple_ros.msg.definitions import message_class
from simple_ros.names import canonical

__all__ = ["BagMessage", "Topic", "topic_of"]


@dataclass(frozen=True, eq=False)
class Topic:
    """A channel of a bag.

    Attributes:
        name: Canonical name of the topic.
        msg_type: Full protobuf name.
        definition: Serialised ``FileDescriptorSet``; empty if it was not known.
        metadata: What the recorder said, see `channel_qos`.
        encoding: Of messages, ``"protobuf"`` for ours.
        schema_encoding: Of the definition.
    """

    name: str
    msg_type: str
    definition: bytes
    metadata: Mapping[str, str]
    encoding: str
    schema_encoding: str

    @property
    def is_latched(self) -> bool:
        """Whether late joiners were given its last message."""
        return self.metadata.get("latched") == "true"

    @cached_property
    def message_class(self) -> type[Message]:
        """The class of its messages, made from the recorded definition.

        Raises:
            UnknownMessageType: The bag has no usable definition.
        """
        if self.encoding != "protobuf" or not self.definition:
            raise UnknownMessageType(self.msg_type)
        try:
            return message_class(FileDescriptorSet.FromString(self.definition), self.msg_type)
        except DecodeError:
            raise UnknownMessageType(self.msg_type) from None


class BagMessage(NamedTuple):
    """A message of a bag; times in ns since 1970-01-01 UTC.

    Attributes:
        topic: Where it was published.
        log_time: When it was recorded.
        data: Its bytes.
        publish_time: When it was published, or recorded first.
        sequence: Its number on its channel.
    """

    topic: Topic
    log_time: int
    data: bytes
    publish_time: int
    sequence: int

    def decoded(self) -> Message:
        """The message as an object, of a class made from the recorded definition.

        Raises:
            UnknownMessageType: The bag has no usable definition.
            google.protobuf.message.DecodeError: The bytes are no such message.
        """
        return self.topic.message_class.FromString(self.data)


def topic_of(channel: Channel, schema: Schema | None) -> Topic:
    """A channel of a file as a topic."""
    return Topic(
        canonical(channel.topic),
        "" if schema is None else schema.name,
        b"" if schema is None else schema.data,
        channel.metadata,
        channel.message_encoding,
        "" if schema is None else schema.encoding,
    )
