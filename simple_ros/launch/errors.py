"""Errors of launch files and of what they start."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from difflib import get_close_matches

from simple_ros.errors import ConfigError, SimpleRosError

__all__ = ["NOWHERE", "LaunchFailed", "LaunchFileError", "Place", "UnknownProcess", "nearest"]


@dataclass(frozen=True, slots=True)
class Place:
    """Where something is written.

    Attributes:
        file: Path as the user would write it.
        line: Counted from 1; 0 for the file as a whole.
        key: Path of keys, as ``launch[0].respawn.limit``; empty at the top.
    """

    file: str
    line: int = 0
    key: str = ""

    def under(self, key: str) -> Place:
        """The same line, one key deeper."""
        return replace(self, key=f"{self.key}.{key}" if self.key else key)

    def __str__(self) -> str:
        line = f":{self.line}" if self.line else ""
        return f"{self.file}{line}{f': {self.key}' if self.key else ''}"


NOWHERE = Place("")
"""For what was not read from a file."""


class LaunchFileError(ConfigError):
    """A launch file or parameter file says something that has no meaning.

    Attributes:
        place: File, line and key.
        reason: What is wrong and what would be right.
    """

    def __init__(self, place: Place, reason: str) -> None:
        self.place = place
        self.reason = reason
        super().__init__(f"{place}: {reason}")


class LaunchFailed(SimpleRosError, RuntimeError):
    """What a launch file describes cannot be started here."""


class UnknownProcess(SimpleRosError, LookupError):
    """No process of that name is supervised.

    Attributes:
        name: The name asked for.
    """

    def __init__(self, name: str, known: Iterable[str]) -> None:
        self.name = name
        super().__init__(f"no process {name!r}{nearest(name, known)}")


def nearest(word: str, known: Iterable[str]) -> str:
    """The end of a message about an unknown word: what it may have meant, or what there is."""
    words = sorted(known)
    close = get_close_matches(word, words, n=2)
    if close:
        return f"; did you mean {' or '.join(map(repr, close))}?"
    return f"; known are {', '.join(words)}" if words else "; there are none"
