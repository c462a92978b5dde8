"""What a converter is, and the parts all of them share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from google.protobuf.message import DecodeError, Message

from simple_ros.errors import SimpleRosError
from simple_ros.msg.definitions import definition_of

__all__ = [
    "DEFAULT_FRAME",
    "Context",
    "ConversionFailed",
    "Converter",
    "MessageConverter",
    "described",
]

M = TypeVar("M", bound=Message)

DEFAULT_FRAME = "world"
"""The frame of messages that name none, as those of C++ simple_ros do."""


class ConversionFailed(SimpleRosError, ValueError):
    """A message cannot be shown: its bytes are no message of the type, or its parts do not fit.

    Attributes:
        topic: Where it came from.
        reason: What is wrong with it.
    """

    def __init__(self, topic: str, reason: str) -> None:
        self.topic = topic
        self.reason = reason
        super().__init__(f"a message on {topic} cannot be shown: {reason}")


@dataclass(frozen=True, slots=True)
class Context:
    """What a converter knows beside the message.

    Attributes:
        receive_time_ns: When it came, ns since 1970; stands in for a stamp that is not set.
        topic: Where it came from.
        frame_id: The frame of messages that name none.
    """

    receive_time_ns: int
    topic: str
    frame_id: str = DEFAULT_FRAME


class Converter(ABC):
    """Turns the messages of one channel into those of another, which a panel understands.

    Some remember what they have shown, so a channel needs a converter of its own, and a new one when
    it starts anew.

    Attributes:
        schema_name: Full name of the type it gives.
        suffix: What follows the topic in the name of the derived topic, such as ``/scene``.
    """

    schema_name: str
    suffix: str

    @property
    @abstractmethod
    def schema(self) -> bytes:
        """A serialised ``FileDescriptorSet`` with every file the type needs, dependencies first."""

    def convert(self, message: bytes, context: Context) -> bytes | None:
        """A serialised message as one of the schema, or None if it has nothing to show.

        Raises:
            ConversionFailed: It makes no sense.
        """
        try:
            return self._converted(message, context)
        except (DecodeError, ValueError) as error:
            raise ConversionFailed(context.topic, str(error)) from error

    @abstractmethod
    def _converted(self, message: bytes, context: Context) -> bytes | None:
        """What `convert` gives.

        Raises:
            DecodeError, ValueError: The message makes no sense.
        """


class MessageConverter(Converter, Generic[M]):
    """Converts by a function over parsed messages.

    Args:
        source: The type that comes.
        target: The type that goes.
        suffix: See `Converter`.
        function: Makes one from the other; None where there is nothing to show.
    """

    def __init__(
        self,
        source: type[M],
        target: type[Message],
        suffix: str,
        function: Callable[[M, Context], Message | None],
    ) -> None:
        self.schema_name = target.DESCRIPTOR.full_name
        self.suffix = suffix
        self._source = source
        self._target = target
        self._function = function

    @property
    def schema(self) -> bytes:
        """See `Converter`."""
        return described(self._target)

    def _converted(self, message: bytes, context: Context) -> bytes | None:
        result = self._function(self._source.FromString(message), context)
        return None if result is None else result.SerializeToString()


def described(message_class: type[Message]) -> bytes:
    """The definition of a type, as `Converter.schema` gives it."""
    return definition_of(message_class).SerializeToString(deterministic=True)
