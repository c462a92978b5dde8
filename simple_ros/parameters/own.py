"""The parameters that one node declared, as values.

Pure: it decides what they are and what a new value would mean; `simple_ros.parameters.local` asks
the Master and calls the user's code.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from simple_ros.parameters.errors import ParameterConflict, ParameterReadOnly
from simple_ros.parameters.tree import Declaration, Origin
from simple_ros.parameters.values import Descriptor, Value, checked

__all__ = ["Own", "OwnParameters"]


@dataclass(slots=True)
class Own:
    """A declared parameter.

    Attributes:
        name: Its full name.
        spelling: How the program wrote that.
        descriptor: What the program said.
        value: What it is now.
        origin: Where that comes from.
        revision: Of the Master's tree, when it came.
    """

    name: str
    spelling: str
    descriptor: Descriptor
    value: Value
    origin: Origin
    revision: int = 0

    def declaration(self) -> Declaration:
        """To tell a Master for the first time."""
        return Declaration(self.name, self.descriptor, self.value, self.origin)

    def repetition(self, *, other_master: bool) -> Declaration:
        """To tell a Master again that may have forgotten it, or another one."""
        origin = self.origin
        if not other_master and origin is Origin.OVERRIDE:
            # What was set there meanwhile is newer than the command line.
            origin = Origin.DEFAULT
        return Declaration(self.name, self.descriptor, self.value, origin, standing=other_master)


class OwnParameters:
    """All of them, by full name."""

    def __init__(self) -> None:
        self._all: dict[str, Own] = {}

    def __contains__(self, name: str) -> bool:
        return name in self._all

    def __getitem__(self, name: str) -> Own:
        return self._all[name]

    def __iter__(self) -> Iterator[Own]:
        return iter(list(self._all.values()))

    def __len__(self) -> int:
        return len(self._all)

    def add(self, own: Own) -> None:
        """Keep one that is declared."""
        self._all[own.name] = own

    def remove(self, name: str) -> None:
        """Forget one, if it is there."""
        self._all.pop(name, None)

    def repeated(self, name: str, descriptor: Descriptor) -> Own | None:
        """What was declared under a name already, in the same way.

        Raises:
            ParameterConflict: It was declared in another way.
        """
        own = self._all.get(name)
        if own is not None and own.descriptor != descriptor:
            raise ParameterConflict(name, "was declared otherwise by the same node")
        return own

    def checked(self, values: Mapping[str, Value]) -> dict[str, Value]:
        """Those of the values that are for declared parameters, in their types.

        Raises:
            ParameterError: One of them cannot be set.
        """
        found = {}
        for name, value in values.items():
            own = self._all.get(name)
            if own is None:
                continue
            found[name] = checked(name, own.descriptor, value)
            if own.descriptor.read_only and repr(found[name]) != repr(own.value):
                raise ParameterReadOnly(name, "is declared read-only")
        return found

    def spelled(self, values: Mapping[str, Value]) -> dict[str, Value]:
        """The same values under the names that the program gave the parameters."""
        return {
            self._all[name].spelling: value for name, value in values.items() if name in self._all
        }

    def apply(self, values: Mapping[str, Value], revision: int | None = None) -> list[Own]:
        """Values are set; returns those that have another value now.

        Args:
            values: By full name; others than the declared ones are nobody's matter here.
            revision: Of the Master's tree; older ones than a parameter has change nothing. None
                without a Master that counts.
        """
        changed = []
        for name, value in values.items():
            own = self._all.get(name)
            if own is None or (revision is not None and revision < own.revision):
                continue
            if revision is not None:
                own.revision = revision
            own.origin = Origin.SET
            if repr(own.value) != repr(value):
                own.value = value
                changed.append(own)
        return changed

    def settle(self, name: str, value: Value, origin: Origin, revision: int) -> list[Own]:
        """A Master answered a declaration; returns the parameter if it has another value now."""
        own = self._all.get(name)
        if own is None or revision < own.revision:
            return []
        own.revision, own.origin = revision, origin
        if repr(own.value) == repr(value):
            return []
        own.value = value
        return [own]

    def new_master(self) -> None:
        """Revisions are counted anew."""
        for own in self:
            own.revision = 0
