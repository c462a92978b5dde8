"""What can be wrong with a parameter.

::

    SimpleRosError
    └── ParameterError              some parameter cannot be read, set, declared or deleted
        ├── UnknownParameter        KeyError         there is none of that name
        ├── ParameterTypeMismatch   TypeError        it is declared with another type
        ├── ParameterOutOfRange     ValueError       its declaration does not allow the value
        ├── ParameterReadOnly       RuntimeError     it cannot be changed any more
        ├── ParameterConflict       ValueError       its name is taken, or its declaration contradicts
        └── ParameterRefused        RuntimeError     the node that declared it said no
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

from simple_ros.errors import SimpleRosError

__all__ = [
    "BadParameterText",
    "ParameterConflict",
    "ParameterError",
    "ParameterOutOfRange",
    "ParameterReadOnly",
    "ParameterRefused",
    "ParameterTypeMismatch",
    "UnknownParameter",
    "error_named",
    "unknown",
]


class ParameterError(SimpleRosError):
    """Something is wrong with one parameter; nothing was changed.

    Attributes:
        name: Its full name.
        reason: What is wrong.
    """

    def __init__(self, name: str, reason: str) -> None:
        self.name = name
        self.reason = reason
        super().__init__(name, reason)

    def __str__(self) -> str:
        return f"parameter {self.name!r}: {self.reason}"


class UnknownParameter(ParameterError, KeyError):
    """There is no parameter of that name."""


class ParameterTypeMismatch(ParameterError, TypeError):
    """A value is of another type than declared, or of none that a parameter can have."""


class ParameterOutOfRange(ParameterError, ValueError):
    """The declaration does not allow the value."""


class ParameterReadOnly(ParameterError, RuntimeError):
    """The parameter cannot be changed any more."""


class ParameterConflict(ParameterError, ValueError):
    """Its name is that of a group or within a parameter, or two declarations contradict each other."""


class ParameterRefused(ParameterError, RuntimeError):
    """A node that declared it refused the value, or did not answer in time."""


class BadParameterText(SimpleRosError, ValueError):
    """A file of parameters, or a value given as text, is wrong.

    Attributes:
        source: Which file; empty for text from elsewhere.
        line: Which line, from 1.
        reason: What is wrong there.
    """

    def __init__(self, source: str, line: int, reason: str) -> None:
        self.source = source
        self.line = line
        self.reason = reason
        super().__init__(f"{source}:{line}: {reason}" if source else reason)


_COMPARED = 500

_BY_NAME: dict[str, type[ParameterError]] = {
    kind.__name__: kind
    for kind in (
        UnknownParameter,
        ParameterTypeMismatch,
        ParameterOutOfRange,
        ParameterReadOnly,
        ParameterConflict,
        ParameterRefused,
    )
}


def error_named(kind: str, name: str, reason: str) -> ParameterError:
    """The error of a class that is given by name, as it comes from the Master."""
    return _BY_NAME.get(kind, ParameterError)(name, reason)


def unknown(name: str, known: Iterable[str]) -> UnknownParameter:
    """The error for a name that is not among the known, with those that look like it."""
    names = sorted(set(known))
    # Comparing takes time, which others wait for.
    alike = get_close_matches(name, names, n=3, cutoff=0.6) if len(names) <= _COMPARED else []
    holding = [other for other in names if name in other or other.endswith("/" + name)]
    near = list(dict.fromkeys(alike + holding))[:3]
    hint = f"; did you mean {' or '.join(map(repr, near))}?" if near else ""
    return UnknownParameter(name, f"there is none of that name{hint}")
