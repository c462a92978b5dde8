"""YAML with the place of every value: text in, `Entry` out.

The same tree is made from plain Python values (`entry_of`), so that a launch file in Python goes
through the same checks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import yaml

from simple_ros.launch.errors import LaunchFileError, Place

__all__ = ["Entry", "Scalar", "Value", "entry_of", "parse_yaml", "plain"]

Scalar = str | int | float | bool | None
Value = Any
"""A scalar, or lists and dictionaries of values."""

_MOST_ENTRIES = 100_000
_DEEPEST = 50


@dataclass(frozen=True, slots=True)
class Entry:
    """A value and where it is written.

    Attributes:
        value: A scalar, a list of entries, or a dictionary from keys to entries.
        place: For the value of a key: the line of the key.
    """

    value: Scalar | list[Entry] | dict[str, Entry]
    place: Place

    @property
    def kind(self) -> str:
        """What it is, for messages."""
        match self.value:
            case dict():
                return "a mapping"
            case list():
                return "a list"
            case None:
                return "nothing"
            case bool():
                return "true" if self.value else "false"
            case value:
                return repr(value)


def plain(entry: Entry) -> Value:
    """The value without places."""
    match entry.value:
        case dict() as fields:
            return {key: plain(item) for key, item in fields.items()}
        case list() as items:
            return [plain(item) for item in items]
        case scalar:
            return scalar


def parse_yaml(text: str, file: str) -> Entry:
    """A YAML document as a tree; nothing is executed, dates stay text.

    Args:
        text: The document; an empty one is a mapping with nothing in it.
        file: Its name, for messages.

    Raises:
        LaunchFileError: It is no YAML, a key stands twice, or it is larger than any launch file.
    """
    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 0
        raise LaunchFileError(Place(file, line), f"is not YAML: {error.problem}") from None
    except yaml.YAMLError as error:
        raise LaunchFileError(Place(file), f"is not YAML: {error}") from None
    if node is None:
        return Entry({}, Place(file))
    return _Composer(file).entry(node, Place(file, node.start_mark.line + 1), 0)


class _Composer:
    """Turns nodes of PyYAML into entries."""

    def __init__(self, file: str) -> None:
        self._file = file
        self._count = 0
        self._scalars = yaml.SafeLoader("")

    def entry(self, node: yaml.Node, place: Place, depth: int) -> Entry:
        self._count += 1
        # Aliases may refer to what they are in, or multiply without end.
        if depth > _DEEPEST or self._count > _MOST_ENTRIES:
            raise LaunchFileError(place, "is nested too deeply, or has too many values")
        match node:
            case yaml.MappingNode():
                return Entry(self._mapping(node, place, depth), place)
            case yaml.SequenceNode():
                items = [
                    self.entry(item, self._place(item, f"{place.key}[{index}]"), depth + 1)
                    for index, item in enumerate(node.value)
                ]
                return Entry(items, place)
            case _:
                return Entry(self._scalar(node, place), place)

    def _mapping(self, node: yaml.MappingNode, place: Place, depth: int) -> dict[str, Entry]:
        fields: dict[str, Entry] = {}
        for key_node, value_node in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                raise LaunchFileError(self._place(key_node, place.key), "a key must be a word")
            key = key_node.value
            where = self._place(key_node, f"{place.key}.{key}" if place.key else key)
            if key in fields:
                first = fields[key].place.line
                raise LaunchFileError(where, f"this key stands in line {first} already")
            fields[key] = self.entry(value_node, where, depth + 1)
        return fields

    def _place(self, node: yaml.Node, key: str) -> Place:
        return Place(self._file, node.start_mark.line + 1, key)

    def _scalar(self, node: yaml.Node, place: Place) -> Scalar:
        try:
            value = self._scalars.construct_object(node, deep=True)
        except (yaml.YAMLError, ValueError) as error:
            raise LaunchFileError(place, f"is no value: {error}") from None
        if value is None or isinstance(value, str | int | float | bool):
            return value
        return str(node.value)


def entry_of(value: Any, place: Place) -> Entry:
    """A tree from plain Python values; an `Entry` in it keeps its own place.

    Raises:
        LaunchFileError: Something in it is no scalar, list or mapping, or a key is no text.
    """
    match value:
        case Entry():
            return value
        case Mapping():
            return Entry(
                {_key(key, place): entry_of(value[key], _at(place, key)) for key in value}, place
            )
        case None | str() | int() | float():
            return Entry(value, place)
        case Sequence():
            items = [
                entry_of(item, Place(place.file, place.line, f"{place.key}[{index}]"))
                for index, item in enumerate(value)
            ]
            return Entry(items, place)
        case _ if hasattr(value, "__fspath__"):
            return Entry(str(value), place)
    raise LaunchFileError(place, f"a {type(value).__name__} cannot stand in a launch file")


def _at(place: Place, key: Any) -> Place:
    return place.under(str(key))


def _key(key: Any, place: Place) -> str:
    if isinstance(key, str):
        return key
    raise LaunchFileError(place, f"a key must be text, not {key!r}")
