"""What topics of bags said last before some time: for whoever jumps there, or begins to look."""

from __future__ import annotations

import threading
from collections.abc import Collection, Iterable
from operator import attrgetter
from pathlib import Path

from simple_ros.bag.messages import BagMessage
from simple_ros.bag.plan import LatchedHistory
from simple_ros.bag.reader import Bag

__all__ = ["LookBack"]

_by_time = attrgetter("log_time")


class LookBack:
    """Reads backwards, while others read the same bags forwards.

    Args:
        paths: The bags. They are opened once more, when they are first needed: a file that is open has
            one position only.
    """

    def __init__(self, paths: Iterable[Path]) -> None:
        self._paths = tuple(paths)
        self._bags: list[Bag] = []
        self._lock = threading.Lock()

    def find(
        self, topics: Collection[str], latched: Collection[str], before_ns: int
    ) -> list[BagMessage]:
        """The last message of each topic before a time, oldest first; blocks meanwhile.

        Args:
            topics: Canonical names.
            latched: Those of them that give late joiners more than one message, if there are several
                that differ.
            before_ns: Only messages before this time.

        Raises:
            BagDamaged: A part of a bag cannot be read.
        """
        kept = set(topics).intersection(latched)
        with self._lock:
            found = self._newest(set(topics) - kept, before_ns, 1)
            found += self._newest(kept, before_ns, LatchedHistory.max_messages)
        return sorted(found, key=_by_time)

    def _newest(self, topics: set[str], before_ns: int, most: int) -> list[BagMessage]:
        found: dict[str, list[BagMessage]] = {}
        for bag in self._opened() if topics else ():
            for message in bag.last_before(topics, before_ns, most):
                found.setdefault(message.topic.name, []).append(message)
        return [message for messages in found.values() for message in _last(messages, most)]

    def _opened(self) -> list[Bag]:
        while len(self._bags) < len(self._paths):
            self._bags.append(Bag(self._paths[len(self._bags)]))
        return self._bags

    def close(self) -> None:
        """Close the files."""
        with self._lock:
            while self._bags:
                self._bags.pop().close()


def _last(messages: list[BagMessage], most: int) -> list[BagMessage]:
    """The newest that differ; parts of a recording repeat what was latched before."""
    newest: dict[bytes, BagMessage] = {}
    for message in sorted(messages, key=_by_time, reverse=True):
        newest.setdefault(message.data, message)
    return list(newest.values())[:most]
