"""Substitutions in the text of launch files: ``$(arg x)`` and its kin. Pure.

============================  =====================================================================
``$(arg NAME)``               an argument of this file; alone in a value it keeps its type
``$(env NAME [DEFAULT])``     an environment variable
``$(find-package MODULE)``    the directory of an importable Python package
``$(dirname)``                the directory of this file
``$(equals A B)``             true if both are the same text
============================  =====================================================================

They nest: ``$(env HOME $(arg home))``. ``$$(`` stands for ``$(``. There are no expressions: what needs
logic is a launch file in Python.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from simple_ros.launch.errors import LaunchFileError, Place, nearest
from simple_ros.launch.source import Entry, Value

__all__ = ["Context", "as_text", "substituted", "substituted_text"]

_NAMES = ("arg", "dirname", "env", "equals", "find-package")


@dataclass(frozen=True, slots=True)
class Context:
    """What substitutions refer to.

    Attributes:
        arguments: Values of the file's arguments.
        environment: Of the launching process.
        directory: Where the file is.
        find_package: The directory of a package, or None if there is none of that name.
    """

    arguments: Mapping[str, Value]
    environment: Mapping[str, str]
    directory: str
    find_package: Callable[[str], str | None]


def substituted(entry: Entry, context: Context) -> Value:
    """A value with everything in it substituted, keys too.

    Raises:
        LaunchFileError: A substitution cannot be carried out.
    """
    match entry.value:
        case str() as text:
            return _value(text, context, entry.place)
        case dict() as fields:
            return {
                substituted_text(key, context, item.place): substituted(item, context)
                for key, item in fields.items()
            }
        case list() as items:
            return [substituted(item, context) for item in items]
        case scalar:
            return scalar


def substituted_text(text: str, context: Context, place: Place) -> str:
    """A text with what is in it substituted."""
    return as_text(_value(text, context, place))


def as_text(value: Value) -> str:
    """A value as it would be written in a launch file."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return "" if value is None else str(value)


def _value(text: str, context: Context, place: Place) -> Value:
    if "$(" not in text:
        return text
    parts: list[Value] = []
    position = 0
    while (start := text.find("$(", position)) >= 0:
        escaped = start > position and text[start - 1] == "$"
        parts.append(text[position : start - escaped])
        if escaped:
            parts.append("$(")
            position = start + 2
            continue
        end = _closing(text, start + 2, place)
        parts.append(_carried_out(text[start + 2 : end], context, place))
        position = end + 1
    parts.append(text[position:])
    filled = [part for part in parts if part != ""]
    if len(filled) == 1:
        return filled[0]
    return "".join(map(as_text, filled))


def _closing(text: str, start: int, place: Place) -> int:
    depth = 1
    for index in range(start, len(text)):
        depth += (text[index] == "(") - (text[index] == ")")
        if not depth:
            return index
    raise LaunchFileError(place, f"a ')' is missing in {text!r}")


def _carried_out(inside: str, context: Context, place: Place) -> Value:
    name, words = _words(inside, context, place)
    match name, words:
        case "arg", [argument]:
            if argument not in context.arguments:
                hint = nearest(argument, context.arguments)
                raise LaunchFileError(place, f"this file has no argument {argument!r}{hint}")
            return context.arguments[argument]
        case "env", [variable]:
            if variable not in context.environment:
                raise LaunchFileError(
                    place,
                    f"environment variable {variable} is not set; "
                    f"a default is written $(env {variable} DEFAULT)",
                )
            return context.environment[variable]
        case "env", [variable, *default]:
            return context.environment.get(variable, " ".join(default))
        case "find-package", [module]:
            found = context.find_package(module)
            if found is None:
                raise LaunchFileError(place, f"there is no Python package {module!r} here")
            return found
        case "dirname", []:
            return context.directory
        case "equals", [one, other]:
            return one == other
    raise LaunchFileError(place, _complaint(name, inside))


def _words(inside: str, context: Context, place: Place) -> tuple[str, list[str]]:
    name, _, rest = inside.strip().partition(" ")
    # What comes from a nested substitution is one word, whatever is in it.
    words, position = [], 0
    while (start := rest.find("$(", position)) >= 0:
        end = _closing(rest, start + 2, place) + 1
        words += _split(rest[position:start], place)
        words.append(substituted_text(rest[start:end], context, place))
        position = end
    return name, words + _split(rest[position:], place)


def _split(text: str, place: Place) -> list[str]:
    try:
        return shlex.split(text)
    except ValueError as error:
        raise LaunchFileError(place, f"{text!r}: {error}") from None


def _complaint(name: str, inside: str) -> str:
    if name in _NAMES:
        return f"$({inside}) has too few or too many words"
    return f"there is no substitution $({name}){nearest(name, _NAMES)}"
