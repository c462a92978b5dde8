"""A mean opinion score (MOS) of a process that follows a path, by its error and its progress. Pure.

Five for a process that is exact and as fast as it was made for, one for one that is neither. Error and progress count
together: who crawls is exact and gets nothing done. Two processes are never compared with each other, so one cannot
look good because another is worse.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from simple_ros.errors import ConfigError

__all__ = ["BEST", "WORST", "Estimator", "is_score"]

WORST, BEST = 1.0, 5.0
_LARGE = 1e6


@dataclass(frozen=True, slots=True)
class Estimator:
    """Judges.

    ``1 + 4 * speed / (1 + (error / tolerance)^2)``, with speed the share of the wanted speed that is reached, 0 to 1.

    Attributes:
        tolerance_m: Error at which half of what an exact process gets is left.
        stale_s: Of a process not heard of for so long nothing good is known.

    Raises:
        ConfigError: A number is not positive.
    """

    tolerance_m: float = 0.15
    stale_s: float = 1.0

    def __post_init__(self) -> None:
        if not (self.tolerance_m > 0 and self.stale_s > 0):
            raise ConfigError("tolerance_m and stale_s must be positive")

    def score(
        self, error_m: float, progress_mps: float, wanted_mps: float, age_s: float = 0.0
    ) -> float:
        """The score, 1 to 5.

        Args:
            error_m: Root mean square distance from the path.
            progress_mps: Along the path.
            wanted_mps: That the process was made for; it does not sink when the process is slowed down.
            age_s: Since it was last heard of.
        """
        if age_s > self.stale_s or not (math.isfinite(error_m) and math.isfinite(progress_mps)):
            return WORST
        reached = min(1.0, max(0.0, progress_mps / wanted_mps)) if wanted_mps > 0 else 1.0
        exact = 1 / (1 + min(_LARGE, abs(error_m) / self.tolerance_m) ** 2)
        return WORST + (BEST - WORST) * reached * exact


def is_score(value: float) -> bool:
    """Whether it is a number from 1 to 5."""
    return WORST <= value <= BEST
