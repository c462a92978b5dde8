"""When an engine looks at what came: pure.

realtime: at once. burst: everything at the end of each interval. optimized: at each tick as many links as
the budget allows, the most critical first, and only those whose newest value changed; a link that was
passed over moves up, so that none waits forever. What does not change is looked at again now and then, so that
those behind the engine can tell a steady link from a dead engine.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from enum import Enum
from typing import Generic, TypeVar

from simple_ros.errors import ConfigError

__all__ = ["Intake", "IntervalControl", "Mode", "mode_of"]

Item = TypeVar("Item")


class Mode(Enum):
    """How an engine works."""

    REALTIME = "realtime"
    BURST = "burst"
    OPTIMIZED = "optimized"


def mode_of(name: str) -> Mode:
    """A mode by its name.

    Raises:
        ConfigError: There is none.
    """
    try:
        return Mode(name)
    except ValueError:
        raise ConfigError(
            f"mode {name!r} is none of {', '.join(mode.value for mode in Mode)}"
        ) from None


@dataclass(slots=True)
class _Waiting(Generic[Item]):
    item: Item
    passed_over: int = 0


class Intake(Generic[Item]):
    """Holds what came until its time.

    Args:
        mode: How to work.
        priority: Of an item; higher goes first (optimized).
        differs: Whether an item tells anything new against the last one of its key that was taken.
        budget: Items a tick (optimized).
        limit: Items that may wait in all (burst); the oldest fall.
        refresh_ticks: A link that tells nothing new is looked at again after so many ticks (optimized).

    Attributes:
        skipped: Items that nobody looked at.
    """

    def __init__(
        self,
        mode: Mode,
        *,
        priority: Callable[[Item], float] = lambda _: 0.0,
        differs: Callable[[Item, Item], bool] = lambda _, __: True,
        budget: int = 20,
        limit: int = 10_000,
        refresh_ticks: int = 5,
    ) -> None:
        self.mode = mode
        self.skipped = 0
        self._priority = priority
        self._differs = differs
        self._budget = budget
        self._limit = limit
        self._queue: list[Item] = []
        self._waiting: dict[Hashable, _Waiting[Item]] = {}
        self._taken: dict[Hashable, Item] = {}
        self._refresh_ticks = refresh_ticks
        self._ticks = 0
        self._taken_tick: dict[Hashable, int] = {}

    def offer(self, key: Hashable, item: Item) -> list[Item]:
        """Something came; gives what to look at now."""
        if self.mode is Mode.REALTIME:
            return [item]
        if self.mode is Mode.BURST:
            self._queue.append(item)
            if len(self._queue) > self._limit:
                self._queue.pop(0)
                self.skipped += 1
        else:
            self._replace(key, item)
        return []

    def _replace(self, key: Hashable, item: Item) -> None:
        last = self._taken.get(key)
        is_recent = self._ticks + 1 - self._taken_tick.get(key, 0) < self._refresh_ticks
        if last is not None and is_recent and not self._differs(last, item):
            self.skipped += 1
            return
        before = self._waiting.get(key)
        self.skipped += before is not None
        self._waiting[key] = _Waiting(item, before.passed_over if before else 0)

    def drain(self) -> list[Item]:
        """All that waits, whatever the budget: it is nobody's any more."""
        due, self._queue = self._queue, []
        due += [waiting.item for waiting in self._waiting.values()]
        self._waiting.clear()
        return due

    def forget(self, key: Hashable) -> None:
        """Keep nothing of a link to compare with."""
        self._taken.pop(key, None)
        self._taken_tick.pop(key, None)

    def tick(self) -> list[Item]:
        """An interval is over; gives what to look at now."""
        if self.mode is Mode.BURST:
            due, self._queue = self._queue, []
            return due
        self._ticks += 1
        ordered = sorted(
            self._waiting.items(),
            key=lambda pair: self._priority(pair[1].item) + 0.1 * pair[1].passed_over,
            reverse=True,
        )
        for _, waiting in ordered[self._budget :]:
            waiting.passed_over += 1
        chosen = ordered[: self._budget]
        for key, waiting in chosen:
            del self._waiting[key]
            self._taken[key] = waiting.item
            self._taken_tick[key] = self._ticks
        return [waiting.item for _, waiting in chosen]


class IntervalControl:
    """Stretches an interval under load: 1.5 times when work takes over 80 % of it, back below 40 %.

    Args:
        base_s: The interval without load.
        most: Never more than this times the base.
    """

    def __init__(self, base_s: float, most: float = 8.0) -> None:
        self.interval_s = base_s
        self._base_s = base_s
        self._most_s = most * base_s

    def worked(self, seconds: float) -> float:
        """A tick took this long; gives the next interval."""
        share = seconds / self.interval_s
        if share > 0.8:
            self.interval_s = min(self._most_s, self.interval_s * 1.5)
        elif share < 0.4:
            self.interval_s = max(self._base_s, self.interval_s / 1.5)
        return self.interval_s
