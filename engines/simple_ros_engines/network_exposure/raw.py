"""Messages of any type as the bytes they are: nothing is parsed, large ones are not copied."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, ClassVar

from simple_ros.codecs import Codec, register_codec
from simple_ros.wire.framing import LENT_BYTES

__all__ = ["Raw", "raw_class"]


class Raw:
    """A message of some type. Made by the classes that `raw_class` returns.

    Attributes:
        data: Its bytes; of a large received one, a read-only view that is valid as long as it is held.
    """

    msg_type: ClassVar[str] = ""

    __slots__ = ("data",)

    def __init__(self, data: bytes | memoryview) -> None:
        self.data = data

    def __len__(self) -> int:
        return len(self.data)


@cache
def raw_class(msg_type: str) -> type[Raw]:
    """The class of messages of a type that are not parsed.

    Args:
        msg_type: Full name on the wire, whether anybody here knows the type or not.
    """
    return type("RawMessage", (Raw,), {"msg_type": msg_type, "__slots__": ()})


class RawCodec(Codec):
    """Lets their bytes through."""

    def handles(self, message_class: type) -> bool:
        """Classes that `raw_class` made."""
        return isinstance(message_class, type) and issubclass(message_class, Raw)

    def type_name(self, message_class: Any) -> str:
        """That of the type."""
        return str(message_class.msg_type)

    def encode(self, message: Any) -> bytes:
        """The bytes."""
        return bytes(message.data)

    def parter(self, message_class: type) -> Callable[[Any], tuple[Any, ...]] | None:  # noqa: ARG002
        """The bytes where they are."""
        return _parts

    def decode(self, data: memoryview, message_class: Any) -> Any:
        """The bytes; large ones stay where they were received."""
        return message_class(data.toreadonly() if len(data) >= LENT_BYTES else bytes(data))


def _parts(message: Raw) -> tuple[Any, ...]:
    return (message.data,)


register_codec(RawCodec())
