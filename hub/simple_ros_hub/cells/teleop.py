"""Commands over a link that may be late or gone: limits, and holding. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass

from simple_ros_engines.cross_domain.mappings import ControlLimits

__all__ = ["HOLD", "CommandGuard", "Velocity"]


@dataclass(frozen=True, slots=True)
class Velocity:
    """A planar velocity: m/s forward and left, rad/s to the left."""

    forward: float
    left: float
    turn: float

    @property
    def is_zero(self) -> bool:
        """Whether it says to stand."""
        return self.forward == self.left == self.turn == 0

    def within(self, speed: float) -> Velocity:
        """The same direction and curve, not faster than ``speed``."""
        size = math.hypot(self.forward, self.left)
        factor = speed / size if size > speed else 1.0
        return Velocity(self.forward * factor, self.left * factor, self.turn * factor)


HOLD = Velocity(0.0, 0.0, 0.0)


class CommandGuard:
    """Decides what becomes of commands.

    Commands that say to stand pass always. After a silence longer than the limits allow it says once to hold.

    Args:
        limits: Of the control loop.

    Attributes:
        limits: Of the control loop; may change at any time.
        is_holding: Whether the robot is held.
        holds: Times it was held.
        limited: Commands that were too fast.
        thinned: Commands that came too often.
    """

    def __init__(self, limits: ControlLimits) -> None:
        self.limits = limits
        self.is_holding = True
        self.holds = 0
        self.limited = 0
        self.thinned = 0
        self._came_s = -math.inf
        self._passed_s = -math.inf

    def command(self, wanted: Velocity, now_s: float) -> Velocity | None:
        """A command came; what to pass on, or None for nothing. A value that is no number counts as hold."""
        if not all(map(math.isfinite, (wanted.forward, wanted.left, wanted.turn))):
            return self._hold()
        self._came_s = now_s
        if not wanted.is_zero and now_s - self._passed_s < 0.9 / self.limits.max_rate_hz:
            self.thinned += 1
            return None
        self._passed_s = now_s
        self.is_holding = False
        kept = wanted.within(self.limits.max_speed_mps)
        self.limited += kept != wanted
        return kept

    def tick(self, now_s: float) -> Velocity | None:
        """Time passed; `HOLD` if the robot is to be held now."""
        if self.is_holding or now_s - self._came_s <= self.limits.hold_timeout_s:
            return None
        return self._hold()

    def hold(self) -> Velocity | None:
        """Hold now, for another reason; None if it is held."""
        return None if self.is_holding else self._hold()

    def _hold(self) -> Velocity:
        self.holds += not self.is_holding
        self.is_holding = True
        return HOLD
