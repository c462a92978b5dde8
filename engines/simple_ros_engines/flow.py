"""What is missing or comes twice on a topic whose messages are numbered: pure."""

from __future__ import annotations

__all__ = ["SequenceWatch"]

_MODULUS = 1 << 32
_REMEMBERED = 512


class SequenceWatch:
    """Watches the numbers of one publisher's messages, 32 bits that start anew after the largest.

    A smaller number that is neither known nor missing is of a publisher that began again.

    Attributes:
        received: Messages that came.
        gaps: Numbers left out, less those that came late after all.
        duplicates: Messages that came before, with the same number and stamp.
        late: Messages that came after larger numbers.
        restarts: How often the publisher began again.
    """

    __slots__ = (
        "_missing", "_newest", "_recent", "duplicates", "gaps", "late", "received", "restarts",
    )  # fmt: skip

    def __init__(self) -> None:
        self.received = self.gaps = self.duplicates = self.late = self.restarts = 0
        self._newest: int | None = None
        self._recent: dict[int, int] = {}
        self._missing: dict[int, None] = {}

    def came(self, number: int, stamp_ns: int) -> bool:
        """A message came; whether it is new."""
        self.received += 1
        if self._recent.get(number) == stamp_ns:
            self.duplicates += 1
            return False
        self._recent[number] = stamp_ns
        if len(self._recent) > _REMEMBERED:
            del self._recent[next(iter(self._recent))]
        self._place(number)
        return True

    def _place(self, number: int) -> None:
        ahead = 1 if self._newest is None else (number - self._newest) % _MODULUS
        if 0 < ahead < _MODULUS // 2:
            if ahead > 1:
                self._left_out(ahead - 1, number)
        elif number in self._missing:
            del self._missing[number]
            self.gaps -= 1
            self.late += 1
            return
        else:
            self.restarts += 1
            self._missing.clear()
        self._newest = number

    def _left_out(self, count: int, number: int) -> None:
        self.gaps += count
        for back in range(min(count, _REMEMBERED), 0, -1):
            self._missing[(number - back) % _MODULUS] = None
        while len(self._missing) > _REMEMBERED:
            del self._missing[next(iter(self._missing))]
