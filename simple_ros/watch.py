"""A deadline that runs on the event loop."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from simple_ros.wire.session import Expectation

__all__ = ["Watchdog"]


class Watchdog:
    """Calls ``on_missed(total)`` each time something expected has not happened for a period.

    One timer of the loop per watchdog, re-armed only when it rings: `happened` costs a time stamp.
    """

    def __init__(self, period_s: float, on_missed: Callable[[int], None]) -> None:
        self._loop = asyncio.get_running_loop()
        self._expectation = Expectation(period_s, self._loop.time())
        self._on_missed = on_missed
        self._handle = self._loop.call_later(period_s, self._ring)

    def happened(self) -> None:
        """What was expected has happened now."""
        self._expectation.happened(self._loop.time())

    def _ring(self) -> None:
        missed = self._expectation.overdue(self._loop.time())
        self._handle = self._loop.call_at(self._expectation.due, self._ring)
        if missed:
            self._on_missed(self._expectation.misses)

    def stop(self) -> None:
        """No more calls."""
        self._handle.cancel()
