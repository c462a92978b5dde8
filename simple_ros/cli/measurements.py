"""How often, how much and how late: pure functions from times and sizes to facts and lines."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from simple_ros.cli.text import duration_text, size_text

__all__ = [
    "BANDWIDTH_TITLES",
    "RATE_TITLES",
    "Spread",
    "bandwidth_cells",
    "bandwidth_facts",
    "bandwidth_line",
    "cpp_rate_text",
    "rate_cells",
    "rate_facts",
    "rate_line",
    "spread",
]


@dataclass(frozen=True, slots=True)
class Spread:
    """Mean, smallest, largest and standard deviation (of the population) of some numbers."""

    mean: float
    minimum: float
    maximum: float
    deviation: float


def spread(values: Sequence[float]) -> Spread:
    """How some numbers, at least one, are spread."""
    mean = statistics.fmean(values)
    return Spread(mean, min(values), max(values), statistics.pstdev(values, mean))


def rate_facts(times_s: Sequence[float]) -> dict[str, Any] | None:
    """Rate and periods of messages that arrived at these times; None if they are too few."""
    if len(times_s) < 2 or times_s[-1] <= times_s[0]:
        return None
    periods = spread([late - early for early, late in pairwise(times_s)])
    return {
        "rate_hz": (len(times_s) - 1) / (times_s[-1] - times_s[0]),
        "min_s": periods.minimum,
        "max_s": periods.maximum,
        "stddev_s": periods.deviation,
        "window": len(times_s),
    }


RATE_TITLES = ("rate", "min period", "max period", "stddev", "window")


def rate_cells(facts: dict[str, Any]) -> tuple[str, ...]:
    """Rate and periods for people, in the order of `RATE_TITLES`."""
    periods = (duration_text(facts[name]) for name in ("min_s", "max_s", "stddev_s"))
    return f"{facts['rate_hz']:.2f} Hz", *periods, str(facts["window"])


def rate_line(facts: dict[str, Any]) -> str:
    """Rate and periods for people, in a line."""
    rate, low, high, deviation, window = rate_cells(facts)
    return f"rate {rate}, period min {low} max {high} stddev {deviation}, window {window}"


def cpp_rate_text(times_s: Sequence[float]) -> str | None:
    """What ``rostopic hz`` of C++ simple_ros prints each second; None if it prints nothing.

    Whole milliseconds and six digits, as there.
    """
    if len(times_s) < 2:
        return None
    duration_ms = int((times_s[-1] - times_s[0]) * 1e3)
    rate = 1e3 * (len(times_s) - 1) / duration_ms if duration_ms else math.inf
    return f"\rAverage rate ({len(times_s)} samples): {rate:.6g} Hz   "


def bandwidth_facts(times_s: Sequence[float], sizes: Sequence[int]) -> dict[str, Any] | None:
    """Bytes a second and sizes of messages that arrived at these times; None if they are too few."""
    if len(times_s) < 2 or times_s[-1] <= times_s[0]:
        return None
    return {
        # The first message begins the time that is measured: its own bytes came before.
        "bytes_per_s": sum(sizes[1:]) / (times_s[-1] - times_s[0]),
        "mean_bytes": statistics.fmean(sizes),
        "min_bytes": min(sizes),
        "max_bytes": max(sizes),
        "window": len(times_s),
    }


BANDWIDTH_TITLES = ("bytes", "mean size", "min size", "max size", "window")


def bandwidth_cells(facts: dict[str, Any]) -> tuple[str, ...]:
    """Bytes a second and sizes for people, in the order of `BANDWIDTH_TITLES`."""
    sizes = (size_text(facts[f"{name}_bytes"]) for name in ("mean", "min", "max"))
    return f"{size_text(facts['bytes_per_s'])}/s", *sizes, str(facts["window"])


def bandwidth_line(facts: dict[str, Any]) -> str:
    """Bytes a second and sizes for people, in a line."""
    rate, mean, low, high, window = bandwidth_cells(facts)
    return f"{rate}, size mean {mean} min {low} max {high}, window {window}"
