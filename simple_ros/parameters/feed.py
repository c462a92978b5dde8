"""What a watcher of parameters has still to be told, and what it makes of it.

Pure. `ParameterFeed` is the Master's side, `ParameterMirror` the watcher's. Memory is bounded: a
watcher that is too slow loses its waiting changes and gets a fresh snapshot, which contains them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from simple_ros.parameters.convert import (
    changes_event,
    parameters_from_proto,
    snapshot_event,
    value_from_proto,
)
from simple_ros.parameters.tree import Change, ParameterTree, is_within
from simple_ros.parameters.values import Value
from simple_ros.rpc import parameters_pb2 as par

__all__ = ["MAX_WAITING", "ParameterChanged", "ParameterFeed", "ParameterMirror"]

MAX_WAITING = 1000
"""Groups of changes that may wait for one watcher."""


class ParameterFeed:
    """Events for one watcher: a snapshot, then changes.

    Args:
        tree: What is watched.
        prefix: Only this parameter or group.
    """

    def __init__(self, tree: ParameterTree, prefix: str) -> None:
        self._tree = tree
        self._prefix = prefix
        self._waiting: deque[par.ParameterEvent] = deque()
        self._needs_snapshot = True

    def add(self, changes: Sequence[Change]) -> bool:
        """A group of changes happened; whether there is something to tell."""
        seen = [change for change in changes if is_within(change.name, self._prefix)]
        if not seen or self._needs_snapshot:
            return self._needs_snapshot
        self._waiting.append(changes_event(seen, seen[0].revision))
        if len(self._waiting) > MAX_WAITING:
            self._waiting.clear()
            self._needs_snapshot = True
        return True

    def take(self) -> par.ParameterEvent | None:
        """The next event, or None if all is told."""
        if self._needs_snapshot:
            self._needs_snapshot = False
            return snapshot_event(self._tree.values(self._prefix), self._tree.revision)
        return self._waiting.popleft() if self._waiting else None


@dataclass(frozen=True, slots=True)
class ParameterChanged:
    """A watched parameter has a value, another one, or has gone.

    Attributes:
        name: Its full name.
        value: What it is now; None if it has gone.
        previous: What it was; None if it was not there.
    """

    name: str
    value: Value | None
    previous: Value | None


class ParameterMirror:
    """The watched parameters as far as a watcher was told.

    Attributes:
        values: By full name.
    """

    def __init__(self) -> None:
        self.values: dict[str, Value] = {}

    def apply(self, event: par.ParameterEvent) -> list[ParameterChanged]:
        """What an event makes different; a snapshot tells again what is known, which is nothing."""
        if event.WhichOneof("kind") == "snapshot":
            found: dict[str, Value | None] = dict.fromkeys(self.values)
            found |= parameters_from_proto(event.snapshot.parameters)
        else:
            found = {
                item.name: value_from_proto(item.name, item.value)
                if item.HasField("value")
                else None
                for item in event.changes.changes
            }
        return [change for name, value in found.items() for change in self._put(name, value)]

    def _put(self, name: str, value: Value | None) -> list[ParameterChanged]:
        previous = self.values.get(name)
        if type(previous) is type(value) and repr(previous) == repr(value):
            return []
        if value is None:
            del self.values[name]
        else:
            self.values[name] = value
        return [ParameterChanged(name, value, previous)]
