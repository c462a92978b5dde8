"""Arguments of launch files: declared with type and default, given as ``name:=value``. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import yaml

from simple_ros.launch.errors import LaunchFileError, Place, nearest
from simple_ros.launch.source import Value
from simple_ros.launch.substitutions import as_text

__all__ = ["TYPES", "Argument", "bound", "converted", "split_words", "type_of"]

TYPES = {"str": str, "int": int, "float": float, "bool": bool, "list": list}


@dataclass(frozen=True, slots=True)
class Argument:
    """One argument of a launch file.

    Attributes:
        type: A key of `TYPES`.
        default: None if it must be given.
        choices: What it may be; empty for anything.
        is_required: Whether it must be given.
    """

    name: str
    type: str
    default: Value
    description: str
    choices: tuple[Value, ...]
    is_required: bool
    place: Place

    def value_of(self, value: Value, place: Place) -> Value:
        """A given value in the type of this argument.

        Raises:
            LaunchFileError: It is not of the type, or not among the choices.
        """
        result = converted(value, self.type, place, f"argument {self.name!r}")
        if self.choices and result not in self.choices:
            known = ", ".join(map(as_text, self.choices))
            raise LaunchFileError(
                place, f"argument {self.name!r} cannot be {as_text(result)!r}; it is one of {known}"
            )
        return result


def type_of(value: Value) -> str:
    """The type an argument has when only its default is written."""
    return next((name for name, kind in reversed(TYPES.items()) if isinstance(value, kind)), "str")


def converted(value: Value, type_name: str, place: Place, what: str) -> Value:
    """A value in one of the `TYPES`; text is read as YAML where that is another type.

    Raises:
        LaunchFileError: It cannot be that.
    """
    if type_name == "str":
        if isinstance(value, list | dict):
            raise LaunchFileError(place, f"{what} must be text, not {value!r}")
        return as_text(value)
    read = _read(value) if isinstance(value, str) else value
    if type_name == "float" and isinstance(read, int) and not isinstance(read, bool):
        return float(read)
    is_truth = isinstance(read, bool)
    if isinstance(read, TYPES[type_name]) and is_truth == (type_name == "bool"):
        return read
    raise LaunchFileError(place, f"{what} must be of type {type_name}, not {as_text(value)!r}")


def _read(text: str) -> Any:
    try:
        # YAML 1.1 calls 1e3 a text.
        return yaml.safe_load(text) if not _is_number(text) else float(text)
    except yaml.YAMLError:
        return text


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return not text.strip().lstrip("+-").isdigit()


def bound(
    declared: Sequence[Argument], given: Mapping[str, tuple[Value, Place]], place: Place
) -> dict[str, Value]:
    """The value of every argument.

    Args:
        declared: The arguments of a file.
        given: Values by name, with the place each is given at.
        place: Who gives them, for what is missing.

    Raises:
        LaunchFileError: One is unknown, missing, or has a value it cannot have.
    """
    known = {argument.name: argument for argument in declared}
    for name, (_, where) in given.items():
        if name not in known:
            raise LaunchFileError(where, f"there is no argument {name!r}{nearest(name, known)}")
    values: dict[str, Value] = {}
    for name, argument in known.items():
        if name in given:
            values[name] = argument.value_of(*given[name])
        elif argument.is_required:
            about = f" ({argument.description})" if argument.description else ""
            raise LaunchFileError(
                place, f"argument {name!r} must be given{about}: {name}:={argument.type.upper()}"
            )
        else:
            values[name] = argument.default
    return values


def split_words(words: Sequence[str]) -> dict[str, str]:
    """``name:=value`` words of a command line as a mapping.

    Raises:
        LaunchFileError: A word is none.
    """
    pairs = {}
    for word in words:
        name, sign, value = word.partition(":=")
        if not sign or not name:
            raise LaunchFileError(Place("command line"), f"{word!r} is not NAME:=VALUE")
        pairs[name] = value
    return pairs
