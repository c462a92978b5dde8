"""What is known of one frame over time: where it stands in its parent."""

from __future__ import annotations

from bisect import bisect_left
from operator import attrgetter
from typing import NamedTuple

from simple_ros.tf.rigid import Rigid

__all__ = ["Entry", "FrameCache", "OutsideCache", "StaticCache", "TimeCache"]


class Entry(NamedTuple):
    """One transform that was received.

    Attributes:
        stamp_ns: When it holds.
        parent: The parent frame.
        rigid: Maps coordinates of the frame to the parent's.
        authority: Who said so, if known.
    """

    stamp_ns: int
    parent: str
    rigid: Rigid
    authority: str


class OutsideCache(Exception):
    """A time is not between the first and the last that are stored."""


class StaticCache:
    """One entry that holds for all times."""

    is_static = True

    def __init__(self) -> None:
        self._entry: Entry | None = None

    def insert(self, entry: Entry) -> bool:
        """Take an entry in place of the last."""
        self._entry = entry
        return True

    def at(self, stamp_ns: int) -> Entry:
        """The entry, at any time."""
        if self._entry is None:
            raise OutsideCache
        return self._entry._replace(stamp_ns=stamp_ns)

    @property
    def latest(self) -> Entry | None:
        """The entry."""
        return self._entry

    def clear(self) -> None:
        """Forget nothing: what is static outlives a jump of time."""


class TimeCache:
    """Entries in the order of their stamps, none older than ``keep_ns`` before the last."""

    is_static = False

    def __init__(self, keep_ns: int) -> None:
        self._keep_ns = keep_ns
        self._entries: list[Entry] = []

    def insert(self, entry: Entry) -> bool:
        """Take an entry, unless it is too old or its stamp is there already (the first one stays)."""
        entries = self._entries
        if not entries or entry.stamp_ns > entries[-1].stamp_ns:
            entries.append(entry)
            self._prune()
            return True
        if entry.stamp_ns < entries[-1].stamp_ns - self._keep_ns:
            return False
        index = bisect_left(entries, entry.stamp_ns, key=attrgetter("stamp_ns"))
        if entries[index].stamp_ns == entry.stamp_ns:
            return False
        entries.insert(index, entry)
        return True

    def _prune(self) -> None:
        limit = self._entries[-1].stamp_ns - self._keep_ns
        if self._entries[0].stamp_ns < limit:
            del self._entries[: bisect_left(self._entries, limit, key=attrgetter("stamp_ns"))]

    def at(self, stamp_ns: int) -> Entry:
        """The frame at a time, between two entries if need be.

        Between entries of two parents the earlier one holds, as in tf2.

        Raises:
            OutsideCache: The time is before the first entry or after the last.
        """
        entries = self._entries
        index = bisect_left(entries, stamp_ns, key=attrgetter("stamp_ns"))
        if index < len(entries) and entries[index].stamp_ns == stamp_ns:
            return entries[index]
        if index in (0, len(entries)):
            raise OutsideCache
        before, after = entries[index - 1], entries[index]
        if before.parent != after.parent:
            return before._replace(stamp_ns=stamp_ns)
        share = (stamp_ns - before.stamp_ns) / (after.stamp_ns - before.stamp_ns)
        rigid = before.rigid.toward(after.rigid, share)
        return Entry(stamp_ns, before.parent, rigid, before.authority)

    @property
    def latest(self) -> Entry | None:
        """The last entry."""
        return self._entries[-1] if self._entries else None

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """Stamps of the first and the last entry."""
        return (self._entries[0].stamp_ns, self._entries[-1].stamp_ns) if self._entries else None

    def __len__(self) -> int:
        return len(self._entries)

    def clear(self) -> None:
        """Forget all."""
        self._entries.clear()


FrameCache = StaticCache | TimeCache
