"""Waiting for a condition, with a limit; never for an amount of time."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

LIMIT_S = 10.0


async def until(condition: Callable[[], object], what: str = "", limit: float = LIMIT_S) -> None:
    """Return once ``condition()`` is true; fail with what was waited for."""
    end = time.monotonic() + limit
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f"not within {limit:g} s: {what or condition}")
        await asyncio.sleep(0.002)
