"""What ``hz`` and ``bw`` measure of a topic: pure, times are given."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from simple_ros.cli.measurements import (
    BANDWIDTH_TITLES,
    RATE_TITLES,
    bandwidth_cells,
    bandwidth_facts,
    bandwidth_line,
    rate_cells,
    rate_facts,
    rate_line,
)

__all__ = ["BANDWIDTH", "NOTHING_NEW", "RATE", "TOO_FEW", "Quantity", "Window"]

NOTHING_NEW = "no new messages"
TOO_FEW = "not enough messages yet"


class Window:
    """When the last messages of a topic came, and how large they were.

    Attributes:
        topic: Its name.
        times: Seconds of any one clock.
        sizes: Bytes.
        is_new: Whether a message came since somebody last looked.
    """

    def __init__(self, topic: str, length: int) -> None:
        self.topic = topic
        self.times: deque[float] = deque(maxlen=length)
        self.sizes: deque[int] = deque(maxlen=length)
        self.is_new = False

    def take(self, now: float, size: int) -> None:
        """A message has come."""
        self.times.append(now)
        self.sizes.append(size)
        self.is_new = True

    def look(self) -> bool:
        """Whether a message came since this was last called."""
        came, self.is_new = self.is_new, False
        return came


@dataclass(frozen=True, slots=True)
class Quantity:
    """One measurement, and how it is written.

    Attributes:
        facts: From a window; None if it holds too few messages.
        line: Facts as a line.
        titles: Of the columns of a table.
        cells: Facts in the order of the titles.
    """

    facts: Callable[[Window], dict[str, Any] | None]
    line: Callable[[dict[str, Any]], str]
    titles: Sequence[str]
    cells: Callable[[dict[str, Any]], Sequence[str]]


RATE = Quantity(lambda window: rate_facts(list(window.times)), rate_line, RATE_TITLES, rate_cells)
BANDWIDTH = Quantity(
    lambda window: bandwidth_facts(list(window.times), list(window.sizes)),
    bandwidth_line,
    BANDWIDTH_TITLES,
    bandwidth_cells,
)
