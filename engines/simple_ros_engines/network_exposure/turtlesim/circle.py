"""Drive along a circle by the poses that come back: a closed loop that suffers when messages are late or lost. Pure.

The turn rate is that of the circle, plus what turns the turtle to the direction of the circle where it is, plus a PID
controller on its distance from it. The speed is the wanted one, a little more while the turtle is behind and less while it
is ahead. Nothing is predicted: a late pose is taken for where the turtle is now, so that delay does to the loop what it
does to a real one.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from simple_ros.errors import ConfigError

__all__ = ["Circle", "CircleController", "Command", "Gains", "Tracking"]

STALE_S = 1.0
"""Without a pose for so long the turtle is stopped."""
_MOST_TURN = 8.0
_MOST_SUM = 1.0
_MOST_LAG_M = 0.3
_LONGEST_STEP_S = 0.5


@dataclass(frozen=True, slots=True)
class Circle:
    """The path: counter-clockwise, in m.

    Raises:
        ConfigError: The radius is not positive.
    """

    x: float
    y: float
    radius: float

    def __post_init__(self) -> None:
        if not self.radius > 0:
            raise ConfigError(f"radius must be positive, not {self.radius}")


@dataclass(frozen=True, slots=True)
class Gains:
    """Of the controller.

    Attributes:
        heading: Turn rate for each rad that the turtle looks elsewhere, 1/s.
        p: Turn rate for each m from the path, rad/s/m.
        i: For each m s.
        d: For each m/s.
        lag: Speed for each m that the turtle is behind, 1/s.
    """

    heading: float = 3.0
    p: float = 4.0
    i: float = 0.2
    d: float = 0.5
    lag: float = 0.8


@dataclass(frozen=True, slots=True)
class Command:
    """What to send: m/s forwards, rad/s."""

    linear: float
    angular: float


@dataclass(frozen=True, slots=True)
class Tracking:
    """How it went over the window.

    Attributes:
        error_m: Root mean square distance from the path.
        progress_mps: Along the path.
        span_s: Length of what is known.
        pose_age_s: Since the last pose came; infinite if none did.
    """

    error_m: float
    progress_mps: float
    span_s: float
    pose_age_s: float


class CircleController:
    """Follows a circle.

    Args:
        path: To follow.
        speed: m/s along it.
        gains: Of the controller.
        window_s: `tracking` looks so far back.

    Attributes:
        factor: Of the speed, in force now.
    """

    def __init__(
        self, path: Circle, speed: float = 1.0, gains: Gains | None = None, window_s: float = 3.0
    ) -> None:
        self.path = path
        self.speed = speed
        self.factor = 1.0
        self._gains = gains or Gains()
        self._window_s = window_s
        self._pose: tuple[float, float, float] | None = None
        self._pose_s = -math.inf
        self._way = 0.0
        self._lag = 0.0
        self._commanded_s: float | None = None
        self._angle: float | None = None
        self._seen: deque[tuple[float, float, float]] = deque()
        self._sum = 0.0
        self._before: tuple[float, float] | None = None

    def pose_came(self, x: float, y: float, theta: float, now_s: float) -> None:
        """Where the turtle was, as far as is known."""
        path = self.path
        self._pose, self._pose_s = (x, y, theta), now_s
        angle = math.atan2(y - path.y, x - path.x)
        if self._angle is not None:
            moved = path.radius * math.remainder(angle - self._angle, 2 * math.pi)
            self._way += moved
            self._be_behind(-moved)
        self._angle = angle
        self._seen.append((now_s, self._off(x, y), self._way))

    def command(self, now_s: float) -> Command:
        """What to send now; a stop if no pose came lately."""
        if self._pose is None or now_s - self._pose_s > STALE_S:
            self._before = self._commanded_s = None
            return Command(0.0, 0.0)
        x, y, theta = self._pose
        speed = self.speed * self.factor
        off = self._off(x, y)
        tangent = math.atan2(y - self.path.y, x - self.path.x) + math.pi / 2
        turned = math.remainder(tangent - theta, 2 * math.pi)
        gains = self._gains
        angular = speed / self.path.radius + gains.heading * turned
        angular += gains.p * off + gains.i * self._sum + gains.d * self._rate(off, now_s)
        if self._commanded_s is not None:
            self._be_behind(speed * min(_LONGEST_STEP_S, now_s - self._commanded_s))
        self._commanded_s = now_s
        # Across the circle there is no direction to keep: turn first.
        linear = max(0.0, speed + gains.lag * self._lag) * max(0.2, math.cos(turned))
        return Command(linear, min(_MOST_TURN, max(-_MOST_TURN, angular)))

    def tracking(self, now_s: float) -> Tracking:
        """How it went lately."""
        seen = self._seen
        while len(seen) > 1 and seen[0][0] < now_s - self._window_s:
            seen.popleft()
        age_s = now_s - self._pose_s
        if len(seen) < 2:
            return Tracking(0.0, 0.0, 0.0, age_s)
        span_s = now_s - seen[0][0]
        square = sum(off * off for _, off, _ in seen) / len(seen)
        progress = (seen[-1][2] - seen[0][2]) / span_s if span_s > 0 else 0.0
        return Tracking(math.sqrt(square), progress, span_s, age_s)

    def _off(self, x: float, y: float) -> float:
        """Distance outwards from the path, m."""
        return math.dist((x, y), (self.path.x, self.path.y)) - self.path.radius

    def _be_behind(self, way: float) -> None:
        self._lag = min(_MOST_LAG_M, max(-_MOST_LAG_M, self._lag + way))

    def _rate(self, off: float, now_s: float) -> float:
        before, self._before = self._before, (now_s, off)
        if before is None or now_s <= before[0]:
            return 0.0
        span_s = now_s - before[0]
        self._sum = min(_MOST_SUM, max(-_MOST_SUM, self._sum + off * span_s))
        return (off - before[1]) / span_s
