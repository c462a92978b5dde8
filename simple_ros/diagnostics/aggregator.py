"""Statuses of all nodes, gathered into groups: pure, time is an argument.

A group takes the statuses whose names begin with one of its prefixes; the longest prefix wins, and what
no group takes is in the group ``Other``. What has not been heard for some seconds is stale. Paths are
made of slashes: ``/Robot/Sensors/lidar: scan``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from simple_ros.diagnostics.status import OK, STALE, Level, level_name, worst
from simple_ros.errors import ConfigError
from simple_ros.msg.diagnostic_msgs import DiagnosticArray, DiagnosticStatus, KeyValue
from simple_ros.time import Time

__all__ = ["OTHER", "Aggregator", "Item"]

OTHER = "Other"
MAX_ITEMS = 10_000


class Item(NamedTuple):
    """A status as it is now.

    Attributes:
        group: The group it is in.
        status: As it was sent.
        level: Its level, or STALE.
        age_s: Seconds since it was heard.
    """

    group: str
    status: DiagnosticStatus
    level: Level
    age_s: float


class _Heard(NamedTuple):
    group: str
    status: DiagnosticStatus
    at_s: float


class Aggregator:
    """The latest status of everything.

    Args:
        groups: Names of groups and the prefixes of what they take.
        base: Name before all paths.
        stale_after_s: Seconds after which a status is stale.

    Raises:
        ConfigError: Two groups share a prefix, a prefix is empty, or the time is not positive.

    Attributes:
        refused: Statuses left out, as there were more names than is believable.
    """

    def __init__(
        self,
        groups: Mapping[str, Sequence[str]] | None = None,
        *,
        base: str = "Robot",
        stale_after_s: float = 5.0,
    ) -> None:
        if not stale_after_s > 0:
            raise ConfigError(f"a status gets stale after more than 0 s, not {stale_after_s}")
        self.refused = 0
        self._base = base
        self._stale_after_s = stale_after_s
        self._group_of = _checked(groups or {})
        self._heard: dict[str, _Heard] = {}

    def receive(self, array: DiagnosticArray, now_s: float) -> None:
        """Take what a node sent."""
        for status in array.status:
            if status.name not in self._heard and len(self._heard) >= MAX_ITEMS:
                self.refused += 1
                continue
            kept = DiagnosticStatus()
            kept.CopyFrom(status)
            self._heard[status.name] = _Heard(self._group(status.name), kept, now_s)

    def forget(self, name: str) -> None:
        """Drop a status, as of a node that is gone for good."""
        self._heard.pop(name, None)

    def items(self, now_s: float) -> tuple[Item, ...]:
        """Every status, by group and name."""
        found = []
        for name in sorted(self._heard, key=lambda name: (self._heard[name].group, name)):
            group, status, at_s = self._heard[name]
            age_s = now_s - at_s
            level = STALE if age_s > self._stale_after_s else status.level
            found.append(Item(group, status, level, age_s))
        return tuple(found)

    def report(self, now: Time, now_s: float) -> DiagnosticArray:
        """All of it: the base, the groups and their members, each group as bad as its worst member.

        Args:
            now: The stamp.
            now_s: The moment, on the clock of `receive`.
        """
        items = self.items(now_s)
        members: dict[str, list[Item]] = {}
        for item in items:
            members.setdefault(item.group, []).append(item)
        array = DiagnosticArray(
            status=[_together(f"/{self._base}", [(item.status.name, item.level) for item in items])]
        )
        array.header.stamp.CopyFrom(now.to_msg())
        for group, found in members.items():
            path = f"/{self._base}/{group}"
            array.status.append(_together(path, [(item.status.name, item.level) for item in found]))
            array.status.extend(_member(path, item) for item in found)
        return array

    def _group(self, name: str) -> str:
        fitting = [prefix for prefix in self._group_of if name.startswith(prefix)]
        return self._group_of[max(fitting, key=len)] if fitting else OTHER


def _checked(groups: Mapping[str, Sequence[str]]) -> dict[str, str]:
    """The group of each prefix."""
    found: dict[str, str] = {}
    for group, prefixes in groups.items():
        for prefix in prefixes:
            if not prefix or prefix in found:
                raise ConfigError(f"group {group!r}: prefix {prefix!r} is empty or given twice")
            found[prefix] = group
    return found


def _together(path: str, members: list[tuple[str, Level]]) -> DiagnosticStatus:
    bad = [name for name, level in members if level != OK]
    message = f"{len(bad)} of {len(members)} are not ok" if bad else f"{len(members)} are ok"
    return DiagnosticStatus(
        name=path,
        level=worst([level for _, level in members]),
        message=message,
        values=[KeyValue(key=name, value=level_name(level)) for name, level in members],
    )


def _member(path: str, item: Item) -> DiagnosticStatus:
    status = DiagnosticStatus()
    status.CopyFrom(item.status)
    status.name = f"{path}/{item.status.name}"
    status.level = item.level
    if item.level == STALE and item.status.level != STALE:
        status.message = f"not heard for {item.age_s:.0f} s; before: {item.status.message}"
    return status
