"""Message types as clients need them, made once per type."""

from __future__ import annotations

import base64
from collections.abc import Callable, Collection
from dataclasses import dataclass

from google.protobuf.message import Message

from simple_ros.msg.definitions import definition_of
from simple_ros.net.master_client import MasterClient

__all__ = ["KnownType", "TypeBook", "schema_text"]


@dataclass(frozen=True, slots=True)
class KnownType:
    """A message type.

    Attributes:
        name: Its full protobuf name.
        message_class: Of its messages.
        definition: Its ``FileDescriptorSet`` with every import, serialised.
    """

    name: str
    message_class: type[Message]
    definition: bytes


def schema_text(definition: bytes) -> str:
    """A serialised ``FileDescriptorSet`` as the protocol wants it."""
    return base64.b64encode(definition).decode()


class TypeBook:
    """Knows the types of this program, and those that nodes declared to the Master.

    Args:
        client: Gives the present connection to the Master.
    """

    def __init__(self, client: Callable[[], MasterClient]) -> None:
        self._client = client
        self._known: dict[str, KnownType] = {}

    async def find(self, type_name: str) -> KnownType:
        """A type by its full name.

        Raises:
            UnknownMessageType: Neither this program nor the Master knows it.
            MasterUnavailable: Nobody answers.
        """
        known = self._known.get(type_name)
        if known is None:
            message_class = await self._client().message_class(type_name)
            definition = definition_of(message_class).SerializeToString(deterministic=True)
            known = KnownType(type_name, message_class, definition)
            self._known[type_name] = known
        return known

    def keep_only(self, type_names: Collection[str]) -> None:
        """Forget the others: a node that comes back may define them otherwise."""
        self._known = {name: known for name, known in self._known.items() if name in type_names}
