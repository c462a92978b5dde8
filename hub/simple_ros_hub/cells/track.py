"""A track that is kept while it cannot be sent. Pure."""

from __future__ import annotations

from typing import Generic, TypeVar

from simple_ros.errors import ConfigError

__all__ = ["Track"]

Item = TypeVar("Item")


class Track(Generic[Item]):
    """Keeps items in order; when it is full every second of the older half is given up.

    So a long silence costs resolution of its beginning, and never the track.

    Args:
        limit: Most items.

    Attributes:
        thinned: Items given up.
    """

    def __init__(self, limit: int = 1000) -> None:
        if limit < 4:
            raise ConfigError(f"a track of {limit} items is none")
        self.thinned = 0
        self._limit = limit
        self._items: list[Item] = []

    def __len__(self) -> int:
        return len(self._items)

    def add(self, item: Item) -> None:
        """One more."""
        self._items.append(item)
        if len(self._items) > self._limit:
            half = self._limit // 2
            # The very first item stays: a track has its begin.
            kept = self._items[0:half:2]
            self.thinned += half - len(kept)
            self._items[:half] = kept

    def take(self) -> list[Item]:
        """All of them; it is empty then."""
        items, self._items = self._items, []
        return items
