"""What holds for the entries of a file or group: namespace, environment, remaps, parameters. Pure."""

from __future__ import annotations

import posixpath
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

from simple_ros.errors import InvalidName
from simple_ros.launch.errors import LaunchFileError, Place
from simple_ros.launch.fields import Fields
from simple_ros.launch.parameters import check_set, merged, parameters_for
from simple_ros.launch.source import Entry, Value, plain
from simple_ros.launch.substitutions import substituted
from simple_ros.names import node_name

__all__ = [
    "SCOPE_KEYS",
    "Files",
    "LaunchSource",
    "Scope",
    "full_name",
    "is_wanted",
    "path_from",
]

SCOPE_KEYS = ("namespace", "env", "remap", "parameters")


class LaunchSource(Protocol):
    """A launch file, in whatever language."""

    @property
    def head(self) -> Entry:
        """A mapping with ``args``; what else is in it is not looked at."""

    def body(self, arguments: Mapping[str, Value]) -> Entry:
        """The file's mapping, once its arguments have values."""


class Files(Protocol):
    """Where files come from. Errors name the place that asks for the file."""

    def launch_file(self, path: str, asked_at: Place) -> LaunchSource:
        """A launch file."""

    def parameter_file(self, path: str, asked_at: Place) -> Entry:
        """The tree of a YAML file."""

    def is_file(self, path: str) -> bool:
        """Whether there is a file."""

    def find_package(self, module: str) -> str | None:
        """The directory of an importable package."""


@dataclass(frozen=True, slots=True)
class Scope:
    """What the entries inside inherit.

    Attributes:
        namespace: Without slashes at its ends; empty at the root.
        parameter_sets: By node name, the later win.
    """

    namespace: str = ""
    environment: Mapping[str, str | None] = field(default_factory=dict)
    remaps: Mapping[str, str | None] = field(default_factory=dict)
    parameter_sets: tuple[Mapping[str, Any], ...] = ()

    def inside(self, fields: Fields, files: Files) -> Scope:
        """The scope of what a mapping with `SCOPE_KEYS` encloses.

        Raises:
            LaunchFileError: A value of these keys has no meaning.
        """
        return Scope(
            full_name(fields, "namespace", self.namespace),
            {**self.environment, **fields.pairs("env")},
            {**self.remaps, **fields.pairs("remap")},
            (*self.parameter_sets, *_sets(fields, files)),
        )

    def with_sets(self, sets: tuple[Mapping[str, Any], ...]) -> Scope:
        """The same with further parameters."""
        return replace(self, parameter_sets=(*self.parameter_sets, *sets))

    def parameters(self, name: str) -> dict[str, Value]:
        """What all sets say for a node."""
        result: dict[str, Value] = {}
        for parameter_set in self.parameter_sets:
            result = merged(result, parameters_for(name, parameter_set))
        return result


def _sets(fields: Fields, files: Files) -> list[Mapping[str, Any]]:
    entry = fields.get("parameters")
    if entry is None or entry.value is None:
        return []
    sets = []
    for item in entry.value if isinstance(entry.value, list) else [entry]:
        if isinstance(item.value, str):
            path = path_from(fields, substituted(item, fields.context))
            read = files.parameter_file(path, item.place)
            check_set(read)
            sets.append(plain(read))
        else:
            check_set(item)
            sets.append(substituted(item, fields.context))
    return sets


def full_name(fields: Fields, key: str, namespace: str) -> str:
    """The name at a key within a namespace; one with a leading slash is absolute.

    Raises:
        LaunchFileError: It breaks the rules of names.
    """
    text = fields.text(key).rstrip("/") if key == "namespace" else fields.text(key)
    if key == "namespace" and not text:
        return "" if fields.text(key) else namespace
    name = text if text.startswith("/") or not namespace else f"{namespace}/{text}"
    try:
        return node_name(name)
    except InvalidName as error:
        raise fields.error(key, f"{name!r} is no name: it {error.reason}") from None


def is_wanted(fields: Fields) -> bool:
    """Whether the conditions ``if`` and ``unless`` let an entry be."""
    return fields.flag("if", default=True) and not fields.flag("unless", default=False)


def path_from(fields: Fields, path: str) -> str:
    """A path as seen from the directory of the file."""
    if not path:
        raise LaunchFileError(fields.entry.place, "a file name is empty")
    return posixpath.normpath(posixpath.join(fields.context.directory, path))
