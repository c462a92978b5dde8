"""Messages that a panel understands as they are, if only their type had the right name.

Panels know ROS types in protobuf under ``ros.<package>.<Type>``. Where the fields agree, the bytes of
our message serve; only the definition that goes with them is another.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from google.protobuf import descriptor_pb2
from google.protobuf.message import Message

from simple_ros.foxglove.convert.base import Context, MessageConverter
from simple_ros.msg.definitions import definition_of

__all__ = ["ros_definition", "ros_name"]

M = TypeVar("M", bound=Message)

_PREFIX = "ros"
_WELL_KNOWN = "google.protobuf"


def ros_name(message_class: type[Message]) -> str:
    """The name a panel knows a type by."""
    return f"{_PREFIX}.{message_class.DESCRIPTOR.full_name}"


def ros_definition(message_class: type[Message]) -> bytes:
    """A ``FileDescriptorSet`` in which the type, and all that is ours in it, has its `ros_name`."""
    definition = descriptor_pb2.FileDescriptorSet()
    definition.CopyFrom(definition_of(message_class))
    ours = {file.name for file in definition.file if not _is_well_known(file)}
    for file in definition.file:
        if file.name in ours:
            _rename(file, ours)
    return definition.SerializeToString(deterministic=True)


def _is_well_known(file: descriptor_pb2.FileDescriptorProto) -> bool:
    return file.package == _WELL_KNOWN


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
