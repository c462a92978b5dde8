"""Parts of messages, as ``--field`` names them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from simple_ros.errors import SimpleRosError

if TYPE_CHECKING:
    from google.protobuf.message import Message

__all__ = [
    "TIMESTAMP",
    "WELL_KNOWN",
    "Descriptor",
    "FieldDescriptor",
    "UnknownField",
    "check_path",
    "is_map",
    "is_repeated",
    "resolve",
    "split_path",
    "stamp_path",
]

# Their stubs know two unrelated classes for each of these.
Descriptor = Any
FieldDescriptor = Any

TIMESTAMP = "google.protobuf.Timestamp"
WELL_KNOWN = "google.protobuf."


class UnknownField(SimpleRosError, LookupError):
    """A message type has no such field.

    Attributes:
        field: The name asked for.
        type_name: The type that should have it.
        where: Path of the part of the message that has this type, empty for the whole.
        known: The fields it has.
    """

    def __init__(self, field: str, type_name: str, where: str, known: Iterable[str]) -> None:
        self.field = field
        self.type_name = type_name
        self.where = where
        self.known = tuple(known)
        place = f" (at {where!r})" if where else ""
        has = f"its fields are {', '.join(self.known)}" if self.known else "it has no fields"
        super().__init__(f"{type_name}{place} has no field {field!r}; {has}")


def is_repeated(field: FieldDescriptor) -> bool:
    """Whether a field has many values; a map has, too."""
    return bool(field.is_repeated)


def is_map(field: FieldDescriptor) -> bool:
    """Whether a field is a map."""
    return field.message_type is not None and field.message_type.GetOptions().map_entry


def split_path(path: str) -> tuple[str, ...]:
    """``poses[0].x`` and ``poses.0.x`` as ``("poses", "0", "x")``."""
    return tuple(path.replace("[", ".").replace("]", "").split("."))


def check_path(descriptor: Descriptor, path: Sequence[str]) -> None:
    """See that messages of a type can have what a path leads to.

    Raises:
        UnknownField: A part of it is no field.
        SimpleRosError: It goes into a single value, or into a list without an index.
    """
    inner: Descriptor | None = descriptor
    listed = False
    for depth, part in enumerate(path):
        where = ".".join(path[:depth])
        if listed:
            if not part.isdigit():
                raise SimpleRosError(f"{where!r} is a list: {where}[0] is its first element")
            listed = False
        elif inner is None:
            raise SimpleRosError(f"{where!r} is a single value: it has no field {part!r}")
        else:
            field = _named(inner, part, where)
            listed = is_repeated(field) and not is_map(field)
            inner = None if is_map(field) else field.message_type


def _named(descriptor: Descriptor, name: str, where: str) -> FieldDescriptor:
    field = descriptor.fields_by_name.get(name)
    if field is None:
        raise UnknownField(name, descriptor.full_name, where, descriptor.fields_by_name)
    return field


def resolve(message: Message, path: Sequence[str]) -> tuple[Message, FieldDescriptor, int | None]:
    """The part of a message that has the last named field of a checked path; an index if that ends it.

    Raises:
        IndexError: A list of this message is shorter than the path wants.
    """
    parent, value = message, message
    field: FieldDescriptor = None
    index: int | None = None
    for part in path:
        if field is not None and is_repeated(field) and index is None:
            index = int(part)
            value = value[index]  # type: ignore[index]
        else:
            parent, index = value, None
            field = parent.DESCRIPTOR.fields_by_name[part]
            value = getattr(parent, part)
    return parent, field, index


def stamp_path(descriptor: Descriptor) -> tuple[str, ...]:
    """Where messages of a type carry their time: ``header.stamp`` or ``stamp``.

    Raises:
        SimpleRosError: Nowhere.
    """
    for path in (("header", "stamp"), ("stamp",)):
        inner: Descriptor | None = descriptor
        for name in path:
            field = inner.fields_by_name.get(name) if inner is not None else None
            inner = None if field is None or is_repeated(field) else field.message_type
        if inner is not None and inner.full_name == TIMESTAMP:
            return path
    raise SimpleRosError(
        f"{descriptor.full_name} has neither header.stamp nor stamp of type {TIMESTAMP}: "
        "its messages do not tell their delay"
    )
