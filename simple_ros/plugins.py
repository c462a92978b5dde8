"""Finding what other packages add: transports, codecs, command line nouns, demos, engines.

A package names its plug-ins in entry points (docs/plugins.md). One that cannot be loaded is an error
only for who asks for it by name; where all are listed it is told and left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

from simple_ros.errors import ConfigError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

__all__ = [
    "CLI",
    "CODECS",
    "DEMOS",
    "ENGINES",
    "TRANSPORTS",
    "BrokenPlugin",
    "UnknownPlugin",
    "load",
    "load_all",
    "names",
]

TRANSPORTS = "simple_ros.transports"
CODECS = "simple_ros.codecs"
ENGINES = "simple_ros.engines"
CLI = "simple_ros.cli"
DEMOS = "simple_ros.demos"


class UnknownPlugin(ConfigError, LookupError):
    """No installed package offers a plug-in of that name.

    Attributes:
        group: Entry point group.
        name: The name asked for.
        known: The names there are.
    """

    def __init__(self, group: str, name: str, known: tuple[str, ...]) -> None:
        self.group = group
        self.name = name
        self.known = known
        kind = group.rpartition(".")[2].removesuffix("s")
        there = ", ".join(known) or "none"
        super().__init__(
            f"no {kind} {name!r} is installed (there are: {there}); "
            f"plug-ins are entry points in the group {group!r}"
        )


class BrokenPlugin(ConfigError, ImportError):
    """A plug-in cannot be loaded.

    Attributes:
        group: Entry point group.
        plugin: Its name.
        reason: Why, in one line.
    """

    def __init__(self, group: str, entry_point: EntryPoint, error: Exception) -> None:
        self.group = group
        self.plugin = entry_point.name
        self.reason = " ".join(f"{type(error).__name__}: {error}".split())
        super().__init__(
            f"plug-in {entry_point.name!r} ({entry_point.value}) cannot be loaded: {self.reason}"
        )


def names(group: str) -> tuple[str, ...]:
    """The names of a group's plug-ins, sorted."""
    return tuple(sorted({entry_point.name for entry_point in _entry_points(group)}))


def load(group: str, name: str) -> Any:
    """The object a plug-in names.

    Raises:
        UnknownPlugin: There is none of that name.
        BrokenPlugin: It cannot be imported.
    """
    for entry_point in _entry_points(group):
        if entry_point.name == name:
            return _loaded(group, entry_point)
    raise UnknownPlugin(group, name, names(group))


def load_all(group: str) -> Iterator[tuple[str, Any | BrokenPlugin]]:
    """All of a group, by name; in place of one that cannot be imported, the error that says why."""
    for entry_point in sorted(_entry_points(group), key=lambda item: item.name):
        try:
            yield entry_point.name, _loaded(group, entry_point)
        except BrokenPlugin as error:
            yield entry_point.name, error


def _entry_points(group: str) -> Iterable[EntryPoint]:
    # Late: most programs have no plug-ins, and this takes longer to import than a message to arrive.
    from importlib.metadata import entry_points

    return entry_points(group=group)


def _loaded(group: str, entry_point: EntryPoint) -> Any:
    try:
        return entry_point.load()
    except Exception as error:
        raise BrokenPlugin(group, entry_point, error) from error
