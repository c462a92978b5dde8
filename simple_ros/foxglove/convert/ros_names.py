"""Messages that a panel understands as they are, if only their type had the right name.

Panels know ROS types in protobuf under ``ros.<package>.<Type>``. Where the fields agree, the bytes of
our message serve; only the definition that goes with them is another.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from google.protobuf import descriptor_pb2
from google.protobuf.message import DecodeError, Message

from simple_ros.foxglove.convert.base import Context, MessageConverter
from simple_ros.msg.definitions import definition_of
from simple_ros.msg.diagnostic_msgs import DiagnosticArray

__all__ = ["as_shown", "completion_for", "ros_definition", "ros_name"]

M = TypeVar("M", bound=Message)

_PREFIX = "ros"
_WELL_KNOWN = "google.protobuf"
_SHOWN_UNDER_ROS = frozenset({DiagnosticArray.DESCRIPTOR.full_name})


def as_shown(type_name: str, definition: bytes) -> tuple[str, bytes]:
    """How the type of a topic is called for panels, which look at some topics by name *and* type.

    The Diagnostics panel takes ``/diagnostics`` itself, not a topic derived from it. Such a type goes
    by its ROS name; the others stay as they are.

    Args:
        type_name: Full protobuf name.
        definition: Its serialised ``FileDescriptorSet``.

    Returns:
        The same two for the clients; unchanged, too, if the definition is none.
    """
    if type_name not in _SHOWN_UNDER_ROS:
        return type_name, definition
    try:
        known = descriptor_pb2.FileDescriptorSet.FromString(definition)
    except DecodeError:
        # Out of a broken bag. Clients say so, as for every other type.
        return type_name, definition
    return f"{_PREFIX}.{type_name}", _renamed(known)


def completion_for(type_name: str) -> Callable[[bytes, int], bytes] | None:
    """What a topic's own messages need before panels see them; None for types that need nothing.

    Panels that take the ROS name break off at a message without a header.

    Args:
        type_name: Full protobuf name, as published.

    Returns:
        A function of the message and the time it came, in ns since 1970. It raises `DecodeError` if
        the bytes are no such message.
    """
    return _stamped if type_name in _SHOWN_UNDER_ROS else None


def _stamped(message: bytes, stamp_ns: int) -> bytes:
    if DiagnosticArray.FromString(message).header.HasField("stamp"):
        return message
    missing = DiagnosticArray()
    missing.header.stamp.FromNanoseconds(stamp_ns)
    # Protobuf merges what is said twice, so nothing that was there is lost.
    return message + missing.SerializeToString()


def ros_name(message_class: type[Message]) -> str:
    """The name a panel knows a type by."""
    return f"{_PREFIX}.{message_class.DESCRIPTOR.full_name}"


def ros_definition(message_class: type[Message]) -> bytes:
    """A ``FileDescriptorSet`` in which the type, and all that is ours in it, has its `ros_name`."""
    return _renamed(definition_of(message_class))


def _renamed(definition: descriptor_pb2.FileDescriptorSet) -> bytes:
    """The definition with all that is not of protobuf itself under its ROS name."""
    result = descriptor_pb2.FileDescriptorSet()
    result.CopyFrom(definition)
    ours = {file.name for file in result.file if file.package != _WELL_KNOWN}
    for file in result.file:
        if file.name in ours:
            _rename(file, ours)
    return result.SerializeToString(deterministic=True)


def _rename(file: descriptor_pb2.FileDescriptorProto, ours: set[str]) -> None:
    file.name = f"{_PREFIX}/{file.name}"
    file.package = f"{_PREFIX}.{file.package}"
    for index, dependency in enumerate(file.dependency):
        if dependency in ours:
            file.dependency[index] = f"{_PREFIX}/{dependency}"
    for message in _messages(file.message_type):
        for field in message.field:
            if field.type_name and not field.type_name.startswith(f".{_WELL_KNOWN}."):
                field.type_name = f".{_PREFIX}{field.type_name}"


def _messages(
    declared: Iterable[descriptor_pb2.DescriptorProto],
) -> Iterator[descriptor_pb2.DescriptorProto]:
    for message in declared:
        yield message
        yield from _messages(message.nested_type)


class RosMessageConverter(MessageConverter[M]):
    """Converts by a function to a message of ours, whose type goes by its `ros_name`."""

    def __init__(
        self,
        source: type[M],
        target: type[Message],
        suffix: str,
        function: Callable[[M, Context], Message | None],
    ) -> None:
        super().__init__(source, target, suffix, function)
        self.schema_name = ros_name(target)

    @property
    def schema(self) -> bytes:
        """See `Converter`."""
        return ros_definition(self._target)
