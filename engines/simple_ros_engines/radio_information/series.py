"""The newest samples of a number, gaps between them filled where that is asked for: pure."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

__all__ = ["Filling", "Series"]


@dataclass(frozen=True, slots=True)
class Filling:
    """Which gaps in a series are filled, by a line between the samples at their ends.

    Attributes:
        period_s: Between samples.
        most: No more than so many missing samples in a row.
    """

    period_s: float
    most: int

    def times_s(self, before_s: float, now_s: float) -> list[float]:
        """Where samples are missing between two; none if too many are."""
        steps = round((now_s - before_s) / self.period_s)
        if not 2 <= steps <= self.most + 1:
            return []
        return [before_s + (now_s - before_s) * step / steps for step in range(1, steps)]


class Series:
    """The newest samples of one number, with their times.

    Args:
        size: How many are kept.
    """

    __slots__ = ("interpolated", "times_s", "values")

    def __init__(self, size: int) -> None:
        self.times_s: deque[float] = deque(maxlen=size)
        self.values: deque[float] = deque(maxlen=size)
        self.interpolated: deque[bool] = deque(maxlen=size)

    def append(self, time_s: float, value: float, filling: Filling | None = None) -> None:
        """Add a sample; one that is not later than the newest replaces nothing and is left out.

        With ``filling``, samples missing before it are put in and marked in `interpolated`.
        """
        if self.times_s and time_s <= self.times_s[-1]:
            return
        if filling is not None and self.times_s:
            self._fill(filling, time_s, value)
        self._add(time_s, value, interpolated=False)

    def _fill(self, filling: Filling, time_s: float, value: float) -> None:
        before_s, before = self.times_s[-1], self.values[-1]
        for at_s in filling.times_s(before_s, time_s):
            share = (at_s - before_s) / (time_s - before_s)
            self._add(at_s, before + share * (value - before), interpolated=True)

    def _add(self, time_s: float, value: float, *, interpolated: bool) -> None:
        self.times_s.append(time_s)
        self.values.append(value)
        self.interpolated.append(interpolated)

    def last(self, count: int) -> list[float]:
        """The newest values, oldest first."""
        values = self.values
        return list(values)[-count:] if count < len(values) else list(values)

    def __len__(self) -> int:
        return len(self.values)
