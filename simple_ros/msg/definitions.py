"""Message definitions as values: take them along, compare them, make classes of them.

A definition travels as a protobuf ``FileDescriptorSet`` with every file it needs, dependencies first.
Two definitions of one name are equal when the messages and enums they consist of are equal; how the
files are called or what else stands in them does not matter.
"""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterable, Iterator
from typing import Any, TypeAlias

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, text_format
from google.protobuf.descriptor import FileDescriptor
from google.protobuf.message import Message

from simple_ros.errors import ConfigError, TypeDefinitionConflict, UnknownMessageType

__all__ = ["TypeStore", "definition_of", "message_class", "parts", "shown"]

MAX_TYPES = 10_000
"""How many types a store holds."""

Part: TypeAlias = "descriptor_pb2.DescriptorProto | descriptor_pb2.EnumDescriptorProto"


def definition_of(message_class: type[Message]) -> descriptor_pb2.FileDescriptorSet:
    """The files that define a message type, dependencies first."""
    files: dict[str, FileDescriptor] = {}

    def visit(file: Any) -> None:
        if file.name not in files:
            for dependency in file.dependencies:
                visit(dependency)
            files[file.name] = file

    visit(message_class.DESCRIPTOR.file)
    found = descriptor_pb2.FileDescriptorSet()
    for file in files.values():
        file.CopyToProto(found.file.add())
    return found


def message_class(files: descriptor_pb2.FileDescriptorSet, type_name: str) -> type[Message]:
    """A class made from a definition, in a descriptor pool of its own.

    Raises:
        UnknownMessageType: The files do not define it, or do not fit together.
    """
    pool = descriptor_pool.DescriptorPool()
    try:
        for file in files.file:
            pool.Add(file)
        return message_factory.GetMessageClass(pool.FindMessageTypeByName(type_name))
    except (KeyError, TypeError) as error:
        raise UnknownMessageType(type_name) from error


def parts(files: descriptor_pb2.FileDescriptorSet, type_name: str) -> dict[str, Part]:
    """The messages and enums a type consists of, itself among them, by full name.

    Raises:
        UnknownMessageType: The files do not define it, or something it needs.
    """
    known = {name: part for file in files.file for name, part in _declared(file)}
    found: dict[str, Part] = {}
    wanted = [type_name]
    while wanted:
        name = wanted.pop()
        if name in found:
            continue
        part = known.get(name)
        if part is None:
            raise UnknownMessageType(name)
        found[name] = part
        if isinstance(part, descriptor_pb2.DescriptorProto):
            wanted += [field.type_name.lstrip(".") for field in part.field if field.type_name]
    return found


def _declared(file: descriptor_pb2.FileDescriptorProto) -> Iterator[tuple[str, Part]]:
    prefix = f"{file.package}." if file.package else ""
    for enum in file.enum_type:
        yield prefix + enum.name, enum
    for message in file.message_type:
        yield from _nested(prefix, message)


def _nested(prefix: str, message: descriptor_pb2.DescriptorProto) -> Iterator[tuple[str, Part]]:
    name = prefix + message.name
    alone = descriptor_pb2.DescriptorProto()
    alone.CopyFrom(message)
    del alone.nested_type[:]
    del alone.enum_type[:]
    yield name, alone
    for enum in message.enum_type:
        yield f"{name}.{enum.name}", enum
    for inner in message.nested_type:
        yield from _nested(f"{name}.", inner)


def shown(files: descriptor_pb2.FileDescriptorSet, type_name: str) -> str:
    """A definition for people: the type first, then what it consists of, by name.

    Raises:
        UnknownMessageType: The files do not define it.
    """
    found = parts(files, type_name)
    names = [type_name, *sorted(found.keys() - {type_name})]
    return "\n".join(_shown_part(name, found[name]) for name in names)


def _shown_part(name: str, part: Part) -> str:
    kind = "message" if isinstance(part, descriptor_pb2.DescriptorProto) else "enum"
    lines = [f"  {_field_line(member)}" for member in _members(part)]
    return "\n".join([f"{kind} {name} {{", *lines, "}", ""])


class TypeStore:
    """Definitions by type name; what is known cannot be redefined."""

    def __init__(self) -> None:
        self._files: dict[str, descriptor_pb2.FileDescriptorSet] = {}
        self._parts: dict[str, Part] = {}

    def __contains__(self, type_name: object) -> bool:
        return type_name in self._files

    def names(self) -> tuple[str, ...]:
        """The types that were added."""
        return tuple(sorted(self._files))

    def get(self, type_name: str) -> descriptor_pb2.FileDescriptorSet | None:
        """The definition of a type, or None."""
        return self._files.get(type_name)

    def keep_only(self, type_names: Collection[str]) -> None:
        """Forget all other types, and with them what may not be redefined."""
        self._files = {name: files for name, files in self._files.items() if name in type_names}
        self._parts = {}
        for name, files in self._files.items():
            self._parts |= parts(files, name)

    def add(self, type_name: str, files: descriptor_pb2.FileDescriptorSet) -> None:
        """Remember a definition; an equal one changes nothing.

        Raises:
            TypeDefinitionConflict: It, or something it consists of, is known with another definition.
            UnknownMessageType: The files do not define it.
            ConfigError: The store is full.
        """
        if type_name not in self._files and len(self._files) >= MAX_TYPES:
            raise ConfigError(f"{MAX_TYPES} message types are known already")
        found = parts(files, type_name)
        for name, part in sorted(found.items()):
            known = self._parts.get(name)
            if known is not None and known != part:
                raise TypeDefinitionConflict(name, _difference(known, part))
        message_class(files, type_name)
        self._parts |= found
        self._files.setdefault(type_name, files)


def _difference(known: Part, new: Part) -> str:
    """The lines that differ, the known definition's with ``-``."""

    def lines(part: Part) -> list[str]:
        return [_field_line(field) for field in _members(part)]

    return "\n".join(
        line
        for line in difflib.unified_diff(lines(known), lines(new), lineterm="", n=0)
        if not line.startswith(("---", "+++", "@@"))
    )


def _members(
    part: Part,
) -> Iterable[descriptor_pb2.FieldDescriptorProto | descriptor_pb2.EnumValueDescriptorProto]:
    if isinstance(part, descriptor_pb2.DescriptorProto):
        return part.field
    return part.value


def _field_line(
    member: descriptor_pb2.FieldDescriptorProto | descriptor_pb2.EnumValueDescriptorProto,
) -> str:
    if isinstance(member, descriptor_pb2.EnumValueDescriptorProto):
        return f"{member.name} = {member.number}"
    kinds = descriptor_pb2.FieldDescriptorProto
    kind = member.type_name.lstrip(".") or kinds.Type.Name(member.type)[5:].lower()
    repeated = "repeated " if member.label == kinds.LABEL_REPEATED else ""
    plain = f"{repeated}{kind} {member.name} = {member.number}"
    rest = descriptor_pb2.FieldDescriptorProto()
    rest.CopyFrom(member)
    for name in ("name", "number", "label", "type", "type_name", "json_name"):
        rest.ClearField(name)
    options = text_format.MessageToString(rest, as_one_line=True).strip()
    return f"{plain} [{options}]" if options else plain
