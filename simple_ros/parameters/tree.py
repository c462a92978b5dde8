"""The tree of parameters: names to values, who declared them, and what changed.

Pure; the Master keeps one, and so does its double for tests. Names are canonical. A name is either a
parameter or a group of them, never both.

Several nodes may declare one parameter, if they agree on its type: each of them is an *owner*, and a
value must suit them all. What a node declared goes when the node goes, except for what somebody set:
that value stays, without a declaration, for the node's next start.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

from simple_ros.names import parameter_name
from simple_ros.parameters.errors import (
    ParameterConflict,
    ParameterError,
    ParameterReadOnly,
    unknown,
)
from simple_ros.parameters.values import Descriptor, Value, checked

__all__ = [
    "Change",
    "Declaration",
    "Entry",
    "Origin",
    "ParameterTree",
    "groups_of",
    "is_within",
    "nested",
]


class Origin(Enum):
    """Where a value comes from."""

    DEFAULT = "default"
    """The declaring node's program."""
    OVERRIDE = "override"
    """The declaring node's command line, launch file or parameter file."""
    SET = "set"
    """Somebody set it."""


@dataclass(slots=True)
class Entry:
    """One parameter.

    Attributes:
        value: What it is now.
        origin: Where that comes from.
        owners: What each live node that declared it says, by node name.
        revision: Of the tree, when the value last changed.
    """

    value: Value
    origin: Origin
    owners: dict[str, Descriptor] = field(default_factory=dict)
    revision: int = 0

    @property
    def descriptor(self) -> Descriptor | None:
        """What its first owner says; None if nobody declares it."""
        return next(iter(self.owners.values()), None)


@dataclass(frozen=True, slots=True)
class Declaration:
    """A node declares a parameter.

    Attributes:
        name: Canonical.
        descriptor: Complete, see `simple_ros.parameters.values.described`.
        value: Its default, or what the node was told to use, or what it uses already.
        origin: Which of these.
        standing: Whether the node uses the value already, under an earlier Master; then it stands.
    """

    name: str
    descriptor: Descriptor
    value: Value
    origin: Origin = Origin.DEFAULT
    standing: bool = False


@dataclass(frozen=True, slots=True)
class Change:
    """A parameter has another value, or has gone.

    Attributes:
        name: Which.
        value: Its value; None if it has gone.
        revision: Of the tree after the change; changes of one group have the same.
    """

    name: str
    value: Value | None
    revision: int


class ParameterTree:
    """All parameters.

    Attributes:
        revision: Grows with every group of changes.
    """

    def __init__(self) -> None:
        self.revision = 0
        self._entries: dict[str, Entry] = {}
        self._groups: dict[str, int] = {}

    def __len__(self) -> int:
        return len(self._entries)

    def __contains__(self, name: str) -> bool:
        return name in self._entries

    # -- looking -------------------------------------------------------------------------------

    def entry(self, name: str) -> Entry:
        """One parameter, to read.

        Raises:
            UnknownParameter: There is none of that name.
        """
        try:
            return self._entries[name]
        except KeyError:
            raise unknown(name, self._entries) from None

    def within(self, prefix: str = "") -> dict[str, Entry]:
        """The parameter of that name or those of that group, by name in order; all for ``""``."""
        if prefix in self._entries:
            return {prefix: self._entries[prefix]}
        if prefix and prefix not in self._groups:
            return {}
        names = sorted(name for name in self._entries if is_within(name, prefix))
        return {name: self._entries[name] for name in names}

    def values(self, prefix: str = "") -> dict[str, Value]:
        """The same, values only."""
        return {name: entry.value for name, entry in self.within(prefix).items()}

    def kept(self) -> dict[str, Value]:
        """What somebody set: all that outlives the nodes."""
        found = self.within().items()
        return {name: entry.value for name, entry in found if entry.origin is Origin.SET}

    def owners_of(self, names: Iterable[str]) -> dict[str, list[str]]:
        """Those of the names that each node declares, by node."""
        found: dict[str, list[str]] = {}
        for name in names:
            for owner in self._entries[name].owners if name in self._entries else ():
                found.setdefault(owner, []).append(name)
        return found

    # -- setting -------------------------------------------------------------------------------

    def plan(self, values: Mapping[str, Value]) -> dict[str, Value]:
        """A group of values as they would be set, in the declared types; changes nothing.

        Raises:
            InvalidName: A name breaks the rules.
            ParameterError: One of them cannot be set; then none is.
        """
        planned = {parameter_name(given): value for given, value in values.items()}
        for name, value in planned.items():
            entry = self._entries.get(name)
            if entry is None:
                self._check_place(name, planned)
            else:
                planned[name] = self._suited(name, entry, value)
        return planned

    def _suited(self, name: str, entry: Entry, value: Value) -> Value:
        for owner, descriptor in entry.owners.items():
            value = checked(name, descriptor, value)
            if descriptor.read_only and not _same(value, entry.value):
                raise ParameterReadOnly(name, f"node {owner!r} declares it read-only")
        return value

    def _check_place(self, name: str, together: Mapping[str, object]) -> None:
        """Check that a new name is no group, and within no parameter, old or set ``together``."""
        if name in self._groups:
            inside = next(iter(self.within(name)))
            raise ParameterConflict(name, f"is a group of parameters, such as {inside!r}")
        for group in groups_of(name):
            if group in self._entries or group in together:
                raise ParameterConflict(name, f"cannot be within {group!r}, which is a parameter")

    def set(self, values: Mapping[str, Value]) -> list[Change]:
        """Set a group, all or nothing; returns what is different now. Raises as `plan`."""
        planned = self.plan(values)
        changed = [
            name
            for name, value in planned.items()
            if name not in self._entries or not _same(self._entries[name].value, value)
        ]
        self.revision += bool(changed)
        for name, value in planned.items():
            self._put(name, value, Origin.SET)
        return [Change(name, planned[name], self.revision) for name in changed]

    def _put(self, name: str, value: Value, origin: Origin) -> None:
        """Give a parameter a value, whose revision the caller has counted."""
        entry = self._entries.get(name)
        if entry is None:
            self._entries[name] = Entry(value, origin, revision=self.revision)
            for group in groups_of(name):
                self._groups[group] = self._groups.get(group, 0) + 1
            return
        if not _same(entry.value, value):
            entry.value, entry.revision = value, self.revision
        entry.origin = origin

    # -- deleting ------------------------------------------------------------------------------

    def delete(self, names: Iterable[str], by: str = "") -> list[Change]:
        """Delete parameters and groups, all or nothing; returns what has gone.

        Args:
            names: Of parameters or groups.
            by: The node that asks: it may take back what it declares.

        Raises:
            UnknownParameter: There is none of that name.
            ParameterConflict: Another node that lives declares one of them.
        """
        doomed: dict[str, None] = {}
        for given in names:
            inside = self.within(parameter_name(given))
            if not inside:
                raise unknown(given, self._entries)
            doomed.update(dict.fromkeys(inside))
        for name in doomed:
            for owner in self._entries[name].owners.keys() - {by}:
                raise ParameterConflict(name, f"node {owner!r} declares it and lives")
        return self._remove(doomed)

    def _remove(self, names: Iterable[str]) -> list[Change]:
        names = list(names)
        self.revision += bool(names)
        for name in names:
            del self._entries[name]
            for group in groups_of(name):
                self._groups[group] -= 1
                if not self._groups[group]:
                    del self._groups[group]
        return [Change(name, None, self.revision) for name in names]

    # -- declaring -----------------------------------------------------------------------------

    def declare(self, owner: str, declarations: Iterable[Declaration]) -> list[Change]:
        """A node declares parameters, all or nothing; returns what is different now.

        The value of each is then the first there is of: what the node uses already (``standing``) or
        was told to use (an override); what somebody set; the node's default.

        Raises:
            InvalidName: A name breaks the rules.
            ParameterError: One of them cannot be declared so.
        """
        chosen = {item.name: (item, *self._choice(owner, item)) for item in declarations}
        for name in chosen:
            if name not in self._entries:
                self._check_place(name, chosen)
        changed = [
            name
            for name, (_, value, _) in chosen.items()
            if name not in self._entries or not _same(self._entries[name].value, value)
        ]
        self.revision += bool(changed)
        for name, (item, value, origin) in chosen.items():
            self._put(name, value, origin)
            self._entries[name].owners[owner] = item.descriptor
        return [Change(name, chosen[name][1], self.revision) for name in changed]

    def _choice(self, owner: str, item: Declaration) -> tuple[Value, Origin]:
        """The value a declaration leads to, and where it comes from."""
        name = parameter_name(item.name)
        given = checked(name, item.descriptor, item.value)
        entry = self._entries.get(name)
        if entry is None:
            return given, item.origin
        others = {node: said for node, said in entry.owners.items() if node != owner}
        for node, said in others.items():
            if said.type != item.descriptor.type:
                raise ParameterConflict(
                    name,
                    f"is declared {item.descriptor.type}, but node {node!r} declares {said.type}",
                )
        if others and not item.standing and item.origin is not Origin.OVERRIDE:
            return checked(name, item.descriptor, entry.value), entry.origin
        if item.standing or item.origin is Origin.OVERRIDE or entry.origin is not Origin.SET:
            for said in others.values():
                given = checked(name, said, given)
            return given, item.origin
        try:
            return checked(name, item.descriptor, entry.value), Origin.SET
        except ParameterError as error:
            reason = (
                f"{error.reason}; that value was set before the node came, see 'simple-ros param'"
            )
            raise type(error)(name, reason) from None

    def release(self, owner: str) -> list[Change]:
        """A node is gone: nobody asks it any more, and what only it declared goes unless it was set."""
        orphans = []
        for name, entry in self._entries.items():
            if (
                entry.owners.pop(owner, None)
                and not entry.owners
                and entry.origin is not Origin.SET
            ):
                orphans.append(name)
        return self._remove(orphans)


def is_within(name: str, prefix: str) -> bool:
    """Whether a parameter is that one or of that group; the empty prefix holds all."""
    return not prefix or name == prefix or name.startswith(prefix + "/")


def groups_of(name: str) -> Iterable[str]:
    """The groups a name is in, the innermost first."""
    position = name.rfind("/")
    while position > 0:
        yield name[:position]
        position = name.rfind("/", 0, position)


def nested(values: Mapping[str, Value]) -> dict[str, Any]:
    """Values by name as a tree of dicts."""
    root: dict[str, Any] = {}
    for name, value in values.items():
        *groups, last = name.split("/")
        place = root
        for group in groups:
            place = place.setdefault(group, {})
        place[last] = value
    return root


def _same(one: Value, other: Value) -> bool:
    """Whether two values are equal and of one type (1, 1.0 and True are not; NaN is itself)."""
    return type(one) is type(other) and repr(one) == repr(other)
