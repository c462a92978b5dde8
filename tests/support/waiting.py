"""Waiting for a condition, with a limit; never for an amount of time."""

from __future__ import annotations

import asyncio
import os
import re
import time
from collections.abc import Callable
from pathlib import Path

# For what is sure to come: only a mistake makes it longer, however busy the machine.
LIMIT_S = 30.0

# A process of a shared machine may stand still so long, also where nothing tells (see `Stopwatch`).
STALL_S = 0.5

_PRESSURE = Path("/proc/pressure/cpu")
_STALLED_US = re.compile(r"^some .*total=(\d+)$", re.MULTILINE)


async def until(condition: Callable[[], object], what: str = "", limit: float = LIMIT_S) -> None:
    """Return once ``condition()`` is true; fail with what was waited for."""
    end = time.monotonic() + limit
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f"not within {limit:g} s: {what or condition}")
        await asyncio.sleep(0.002)


class Stopwatch:
    """For upper limits on what takes time: leaves out when processes waited for a processor.

    On a machine with nothing else to do it shows the time that passed, on a busy one less.
    """

    def __init__(self) -> None:
        self._began = time.monotonic()
        self._stalled_s = _stalled_s()

    @property
    def passed(self) -> float:
        """Time since the start, as a clock on the wall tells it."""
        return time.monotonic() - self._began

    @property
    def seconds(self) -> float:
        """Time since the start that this machine had for what is measured."""
        return self.passed - self.hindered

    @property
    def hindered(self) -> float:
        """Time since the start in which something waited for a processor."""
        passed = self.passed
        processors = os.cpu_count() or 1
        if self._stalled_s is not None and (stalled_s := _stalled_s()) is not None:
            # Linux tells a mean over the processors; all who wait may wait for one of them.
            return min(passed, processors * (stalled_s - self._stalled_s))
        return passed * (1 - 1 / max(1.0, os.getloadavg()[0] / processors))


def _stalled_s() -> float | None:
    """For how long, of all time, a process waited for a processor; None where Linux does not tell."""
    try:
        found = _STALLED_US.search(_PRESSURE.read_text())
    except OSError:
        return None
    return int(found[1]) / 1e6 if found else None
