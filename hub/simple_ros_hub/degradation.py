"""Graceful degradation: how much is given up while things go badly. Pure.

NORMAL gives up nothing. REDUCED halves the rates of what is not important. ESSENTIAL leaves only what is
important. SAFE leaves commands, and robots hold. A worse level comes after half a second, a
better one, one at a time, after two seconds each.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

__all__ = ["LIMITS", "DegradationJudge", "Level", "LevelLimits", "Strain", "judge"]


class Level(IntEnum):
    """How much is given up."""

    NORMAL = 0
    REDUCED = 1
    ESSENTIAL = 2
    SAFE = 3


@dataclass(frozen=True, slots=True)
class LevelLimits:
    """What a level means for cells.

    Attributes:
        min_priority: Cells below send nothing.
        rate_factor: Of what the others would send.
    """

    min_priority: int
    rate_factor: float


LIMITS = {
    Level.NORMAL: LevelLimits(1, 1.0),
    Level.REDUCED: LevelLimits(1, 0.5),
    Level.ESSENTIAL: LevelLimits(4, 0.5),
    Level.SAFE: LevelLimits(5, 0.25),
}


@dataclass(frozen=True, slots=True)
class Strain:
    """What is judged.

    Attributes:
        load: Blocks wished over blocks there are.
        best_quality: Of the best link, 0..1; None while no link is known.
        engines_down: Required engines that do not work.
        hub_load: Share of its time that the hub works.
    """

    load: float = 0.0
    best_quality: float | None = None
    engines_down: tuple[str, ...] = ()
    hub_load: float = 0.0


def judge(strain: Strain, margin: float = 0.0) -> tuple[Level, str]:
    """The level for a strain, and why.

    Args:
        strain: Now.
        margin: Thresholds are easier to reach by this share: for what wants to be left.
    """
    ease = 1 - margin
    quality = strain.best_quality
    if quality is not None and quality < 0.1 / ease:
        return Level.SAFE, f"best link has quality {quality:.2f}"
    if quality is not None and quality < 0.25 / ease:
        return Level.ESSENTIAL, f"best link has quality {quality:.2f}"
    if strain.load > 2.0 * ease:
        return Level.ESSENTIAL, f"{strain.load:.1f} times the resources are wished"
    if strain.engines_down:
        return Level.REDUCED, f"{', '.join(strain.engines_down)} down"
    if strain.load > 1.2 * ease:
        return Level.REDUCED, f"{strain.load:.1f} times the resources are wished"
    if strain.hub_load > 0.8 * ease:
        return Level.REDUCED, f"the hub is busy {strain.hub_load:.0%} of its time"
    return Level.NORMAL, "everything fits"


class DegradationJudge:
    """Holds the level.

    Args:
        worse_after_s: How long things must have been worse.
        better_after_s: How long they must have been better, for each step.
        margin: See `judge`.
        level: To begin with.

    Attributes:
        level: Now.
        reason: Why.
    """

    def __init__(
        self,
        worse_after_s: float = 0.5,
        better_after_s: float = 2.0,
        margin: float = 0.1,
        level: Level = Level.NORMAL,
    ) -> None:
        self.level = level
        self.reason = "everything fits" if level is Level.NORMAL else "as before"
        self._worse_after_s = worse_after_s
        self._better_after_s = better_after_s
        self._margin = margin
        self._worse_since_s: float | None = None
        self._better_since_s: float | None = None

    def update(self, strain: Strain, now_s: float) -> bool:
        """Judge again; whether the level changed."""
        level, reason = judge(strain)
        if level < self.level:
            level, reason = max((level, reason), self._eased(strain))
        if level > self.level:
            self._better_since_s = None
            return self._worse(level, reason, now_s)
        self._worse_since_s = None
        if level == self.level:
            self._better_since_s, self.reason = None, reason
            return False
        return self._better(reason, now_s)

    def _eased(self, strain: Strain) -> tuple[Level, str]:
        level, reason = judge(strain, self._margin)
        return min(level, self.level), reason

    def _worse(self, level: Level, reason: str, now_s: float) -> bool:
        if self._worse_since_s is None:
            self._worse_since_s = now_s
        if now_s - self._worse_since_s < self._worse_after_s:
            return False
        self._worse_since_s = None
        self.level, self.reason = level, reason
        return True

    def _better(self, reason: str, now_s: float) -> bool:
        if self._better_since_s is None:
            self._better_since_s = now_s
        if now_s - self._better_since_s < self._better_after_s:
            return False
        self._better_since_s = now_s
        self.level = Level(self.level - 1)
        self.reason = reason if self.level is Level.NORMAL else f"it gets better: {reason}"
        return True
