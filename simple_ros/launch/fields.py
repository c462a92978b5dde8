"""Typed reading of a mapping in a launch file; every complaint names file, line and key. Pure."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from enum import Enum
from typing import TypeVar

from simple_ros.launch.arguments import converted
from simple_ros.launch.errors import LaunchFileError, nearest
from simple_ros.launch.source import Entry, Value
from simple_ros.launch.substitutions import Context, as_text, substituted

__all__ = ["Fields"]

Choice = TypeVar("Choice", bound=Enum)
_UNITS = {"": 1, "KB": 1000, "MB": 1000**2, "GB": 1000**3, "KIB": 2**10, "MIB": 2**20, "GIB": 2**30}
_SIZE = re.compile(r"(\d+(?:\.\d+)?)\s*([KMG]?I?B?)", re.IGNORECASE)


class Fields:
    """The keys of a mapping.

    Args:
        entry: The mapping.
        known: Keys it may have.
        context: For substitutions.

    Raises:
        LaunchFileError: It is no mapping, or has another key.
    """

    def __init__(self, entry: Entry, known: Iterable[str], context: Context) -> None:
        if not isinstance(entry.value, dict):
            raise LaunchFileError(entry.place, f"must be a mapping, not {entry.kind}")
        known = list(known)
        for key, item in entry.value.items():
            if key not in known:
                raise LaunchFileError(
                    item.place, f"there is no key {key!r} here{nearest(key, known)}"
                )
        self.entry = entry
        self.context = context
        self._fields = entry.value

    def __contains__(self, key: str) -> bool:
        return key in self._fields

    def get(self, key: str) -> Entry | None:
        """What is written there, or None."""
        return self._fields.get(key)

    def error(self, key: str, reason: str) -> LaunchFileError:
        """An error about a key."""
        return LaunchFileError(self._fields[key].place, reason)

    def value(self, key: str) -> Value:
        """The value with everything substituted; None if the key is not there."""
        entry = self._fields.get(key)
        return None if entry is None else substituted(entry, self.context)

    def text(self, key: str, default: str = "") -> str:
        """Text; a number is text, too."""
        return default if key not in self else str(self._typed(key, "str"))

    def flag(self, key: str, *, default: bool) -> bool:
        """True or false."""
        return default if key not in self else bool(self._typed(key, "bool"))

    def integer(self, key: str, lowest: int = 0, highest: float = math.inf) -> int | None:
        """A whole number between bounds, or None."""
        if key not in self:
            return None
        number = int(self._typed(key, "int"))
        if not lowest <= number <= highest:
            bound = f"at least {lowest}" if number < lowest else f"at most {highest:g}"
            raise self.error(key, f"must be {bound}, not {number}")
        return number

    def seconds(self, key: str, default: float) -> float:
        """A time in seconds that is not negative."""
        if key not in self:
            return default
        number = float(self._typed(key, "float"))
        if not 0 <= number < math.inf:
            raise self.error(key, f"must be a number of seconds, not {number:g}")
        return number

    def size_bytes(self, key: str) -> int | None:
        """A size: a number of bytes, or with a unit as ``512MiB``; or None."""
        if key not in self:
            return None
        text = self.text(key)
        match = _SIZE.fullmatch(text.strip())
        unit = match[2].upper() if match else ""
        scale = _UNITS.get(unit if unit.endswith("B") or not unit else f"{unit}B")
        if match is None or scale is None or not float(match[1]):
            raise self.error(key, f"must be a size as 512MiB or 2GB, not {text!r}")
        return int(float(match[1]) * scale)

    def choice(self, key: str, default: Choice) -> Choice:
        """One of the values of an enum."""
        if key not in self:
            return default
        text, known = self.text(key), [item.value for item in type(default)]
        if text not in known:
            raise self.error(key, f"cannot be {text!r}; it is one of {', '.join(known)}")
        return type(default)(text)

    def texts(self, key: str) -> list[str]:
        """A list of texts; one text alone is a list of one."""
        value = self.value(key)
        if value is None:
            return []
        items = value if isinstance(value, list) else [value]
        if any(isinstance(item, list | dict) for item in items):
            raise self.error(key, "must be a list of texts")
        return [as_text(item) for item in items]

    def pairs(self, key: str) -> dict[str, str | None]:
        """A mapping of texts."""
        value = self.value(key)
        if value is None:
            return {}
        if not isinstance(value, dict):
            raise self.error(key, f"must be a mapping, not {as_text(value)!r}")
        for name, item in value.items():
            if isinstance(item, list | dict):
                raise self.error(key, f"the value of {name!r} must be text")
        return {name: None if item is None else as_text(item) for name, item in value.items()}

    def items(self, key: str) -> list[Entry]:
        """The items of a list, as they are written."""
        entry = self._fields.get(key)
        if entry is None or entry.value is None:
            return []
        if not isinstance(entry.value, list):
            raise self.error(key, f"must be a list (lines that begin with '-'), not {entry.kind}")
        return entry.value

    def _typed(self, key: str, type_name: str) -> Value:
        return converted(self.value(key), type_name, self._fields[key].place, repr(key))
