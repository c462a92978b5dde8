"""From many figures to few: percentiles, medians over rounds, ratios round by round."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

__all__ = ["NOISY", "Spread", "latencies", "noise", "ratios"]

_WARM_UP_PART = 10
NOISY = 1.25
"""From where on the spread of a baseline over the rounds makes figures doubtful."""


@dataclass(frozen=True, slots=True)
class Spread:
    """Median, least and greatest of some figures."""

    median: float
    least: float
    most: float

    @classmethod
    def of(cls, figures: Sequence[float]) -> Self:
        """Of at least one figure."""
        return cls(statistics.median(figures), min(figures), max(figures))

    def as_json(self) -> dict[str, float]:
        """Its three figures by name."""
        return {"median": self.median, "min": self.least, "max": self.most}


def latencies(took_s: Sequence[float]) -> dict[str, float]:
    """Percentiles of times in seconds, without the first tenth; nothing if there are none."""
    kept = sorted(took_s[len(took_s) // _WARM_UP_PART :])
    if not kept:
        return {}
    found = {"p50": statistics.median(kept)}
    found |= {f"p{part}": kept[int(part / 100 * len(kept))] for part in (95, 99)}
    in_us = {f"{name}_us": 1e6 * value for name, value in found.items()}
    return in_us | {f"{name}_ms": 1e3 * value for name, value in found.items()}


def ratios(ours: Sequence[float | None], theirs: Sequence[float | None]) -> Spread | None:
    """Ours / theirs, round by round; None if there is no round with both."""
    found = [mine / other for mine, other in zip(ours, theirs, strict=False) if mine and other]
    return Spread.of(found) if found else None


def noise(baseline: Sequence[float]) -> float:
    """How far a baseline moved from round to round: greatest / least."""
    return max(baseline) / min(baseline) if baseline and min(baseline) > 0 else 1.0
