"""The plane of the turtles: who is where, who drives how fast, what lines were drawn. Pure.

Sizes and rules are those of turtlesim of ROS: a square of 500 pixels, 45 of them a metre; a command counts for one
second; a turtle stops at the wall. Other than there, each turtle keeps only its last `TRAIL` pieces of line, and may
slip: without something to correct, a loop would not care when its messages come.
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

from simple_ros.errors import SimpleRosError

__all__ = ["SIDE_M", "Pen", "Slip", "Stroke", "Turtle", "TurtleRefused", "World"]

SIDE_M = 499 / 45
"""Length of a side, m."""
COMMAND_S = 1.0
"""So long a command counts."""
TRAIL = 2000
MOST_TURTLES = 64
_LEAST_STROKE_M = 0.02
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_FAR = 1e6


class TurtleRefused(SimpleRosError, ValueError):
    """A turtle cannot be what it is to be.

    Attributes:
        name: Of the turtle.
        reason: Why not.
    """

    def __init__(self, name: str, reason: str) -> None:
        self.name = name
        self.reason = reason
        super().__init__(f"turtle {name!r} {reason}")


@dataclass(frozen=True, slots=True)
class Slip:
    """Turn rate that nobody asked for, as of wheels that slip: an Ornstein-Uhlenbeck process for each turtle.

    Attributes:
        sigma: Its standard deviation, rad/s.
        tau_s: It is forgotten in about so long.
        draw: Gives numbers of the standard normal distribution.
    """

    sigma: float
    tau_s: float
    draw: Callable[[], float]

    def next(self, value: float, span_s: float) -> float:
        """The turn rate a little later."""
        kept = math.exp(-span_s / self.tau_s)
        return kept * value + self.sigma * math.sqrt(1 - kept * kept) * self.draw()


@dataclass(frozen=True, slots=True)
class Pen:
    """How a line is drawn: colour of parts 0 to 255, width in pixels, or not at all."""

    r: int = 0xB3
    g: int = 0xB8
    b: int = 0xFF
    width: int = 3
    is_off: bool = False


@dataclass(frozen=True, slots=True)
class Stroke:
    """A straight piece of a line.

    Attributes:
        number: Counts up over all turtles of a world.
        start: x and y in m.
        end: The same.
        pen: Drew it.
    """

    number: int
    start: tuple[float, float]
    end: tuple[float, float]
    pen: Pen


@dataclass(slots=True)
class Turtle:
    """One turtle.

    Attributes:
        name: Of it.
        x: m.
        y: m.
        theta: rad, counter-clockwise from the x axis, -pi to pi.
        linear: m/s, forwards.
        lateral: m/s, to its left.
        angular: rad/s.
        slipping: rad/s that it turns without being told to.
        pen: Draws its line.
        strokes: The line, oldest first.
        at_wall: Whether it stands at a wall and pushes.
    """

    name: str
    x: float
    y: float
    theta: float
    linear: float = 0.0
    lateral: float = 0.0
    angular: float = 0.0
    slipping: float = 0.0
    pen: Pen = field(default_factory=Pen)
    strokes: deque[Stroke] = field(default_factory=lambda: deque(maxlen=TRAIL))
    at_wall: bool = False
    drawn_to: tuple[float, float] = (0.0, 0.0)
    commanded_s: float = -math.inf


class World:
    """The plane and its turtles.

    Args:
        slip: Disturbs turtles that move; None disturbs none.

    Attributes:
        turtles: By name, in the order they came.
        cleared: How often the lines were wiped.
    """

    def __init__(self, slip: Slip | None = None) -> None:
        self._slip = slip
        self.turtles: dict[str, Turtle] = {}
        self.cleared = 0
        self._drawn = 0

    def spawn(self, x: float, y: float, theta: float, name: str = "") -> Turtle:
        """A new turtle.

        Args:
            x: Where, m.
            y: Where, m.
            theta: Where it looks, rad.
            name: Empty takes the next free of ``turtle1``, ``turtle2`` and so on.

        Raises:
            TurtleRefused: The name is taken or no name, the place is outside, or there are too many.
        """
        name = name or self._free_name()
        if not _NAME.fullmatch(name):
            raise TurtleRefused(name, "has no proper name: letters, digits and underscores")
        if name in self.turtles:
            raise TurtleRefused(name, "is there already")
        if len(self.turtles) >= MOST_TURTLES:
            raise TurtleRefused(name, f"is one too many: there are {MOST_TURTLES}")
        _check_place(name, x, y, theta)
        turtle = Turtle(name, x, y, _wrapped(theta), drawn_to=(x, y))
        self.turtles[name] = turtle
        return turtle

    def kill(self, name: str) -> None:
        """A turtle less, and its line.

        Raises:
            TurtleRefused: There is none of that name.
        """
        self.turtle(name)
        del self.turtles[name]

    def turtle(self, name: str) -> Turtle:
        """The turtle of a name.

        Raises:
            TurtleRefused: There is none.
        """
        if name not in self.turtles:
            raise TurtleRefused(
                name, f"is not there; known are {', '.join(self.turtles) or 'none'}"
            )
        return self.turtles[name]

    def command(
        self, name: str, linear: float, lateral: float, angular: float, now_s: float
    ) -> bool:
        """Drive so for a second.

        Args:
            name: Of the turtle.
            linear: m/s, forwards.
            lateral: m/s, to its left.
            angular: rad/s.
            now_s: The time.

        Returns:
            Whether it was obeyed: a command that is not finite is not.
        """
        turtle = self.turtles.get(name)
        if turtle is None or not all(
            math.isfinite(part) and abs(part) < _FAR for part in (linear, lateral, angular)
        ):
            return False
        turtle.linear, turtle.lateral, turtle.angular = linear, lateral, angular
        turtle.commanded_s = now_s
        return True

    def step(self, span_s: float, now_s: float) -> list[Turtle]:
        """Move all turtles on; those that have just run into a wall.

        Args:
            span_s: How long.
            now_s: The time at the end.
        """
        return [turtle for turtle in self.turtles.values() if self._move(turtle, span_s, now_s)]

    def set_pen(self, name: str, pen: Pen) -> None:
        """Draw so from now on; a width of 0 keeps the width.

        Raises:
            TurtleRefused: There is no such turtle.
        """
        turtle = self.turtle(name)
        self._draw(turtle)
        turtle.pen = pen if pen.width else replace(pen, width=turtle.pen.width)
        turtle.drawn_to = (turtle.x, turtle.y)

    def teleport(self, name: str, x: float, y: float, theta: float) -> None:
        """Put a turtle elsewhere; its pen draws the way there.

        Raises:
            TurtleRefused: There is no such turtle, or the place is outside.
        """
        turtle = self.turtle(name)
        _check_place(name, x, y, theta)
        turtle.x, turtle.y, turtle.theta = x, y, _wrapped(theta)
        self._draw(turtle)

    def teleport_by(self, name: str, linear: float, angular: float) -> None:
        """Turn a turtle, then push it along where it looks, up to the wall.

        Raises:
            TurtleRefused: There is no such turtle, or a number is not finite.
        """
        turtle = self.turtle(name)
        if not (math.isfinite(linear) and math.isfinite(angular)):
            raise TurtleRefused(name, "cannot be moved by what is not finite")
        theta = _wrapped(turtle.theta + angular)
        x = _clamped(turtle.x + linear * math.cos(theta))
        y = _clamped(turtle.y + linear * math.sin(theta))
        self.teleport(name, x, y, theta)

    def clear(self) -> None:
        """Wipe all lines."""
        self.cleared += 1
        for turtle in self.turtles.values():
            turtle.strokes.clear()
            turtle.drawn_to = (turtle.x, turtle.y)

    def reset(self) -> None:
        """No turtle, no line."""
        self.turtles.clear()
        self.clear()

    def strokes(self, after: int) -> Iterator[tuple[str, Stroke]]:
        """Pieces of line with higher numbers than that, with whose they are."""
        for turtle in self.turtles.values():
            newer: list[Stroke] = []
            for stroke in reversed(turtle.strokes):
                if stroke.number <= after:
                    break
                newer.append(stroke)
            for stroke in reversed(newer):
                yield turtle.name, stroke

    def _free_name(self) -> str:
        number = 1
        while f"turtle{number}" in self.turtles:
            number += 1
        return f"turtle{number}"

    def _move(self, turtle: Turtle, span_s: float, now_s: float) -> bool:
        if now_s - turtle.commanded_s > COMMAND_S:
            turtle.linear = turtle.lateral = turtle.angular = 0.0
        # The direction in the middle of the step: a circle stays a circle.
        angular = turtle.angular + self._slipping(turtle, span_s)
        middle = turtle.theta + angular * span_s / 2
        cos, sin = math.cos(middle), math.sin(middle)
        x = turtle.x + (turtle.linear * cos - turtle.lateral * sin) * span_s
        y = turtle.y + (turtle.linear * sin + turtle.lateral * cos) * span_s
        turtle.theta = _wrapped(turtle.theta + angular * span_s)
        turtle.x, turtle.y = _clamped(x), _clamped(y)
        hits = (turtle.x, turtle.y) != (x, y)
        is_new, turtle.at_wall = hits and not turtle.at_wall, hits
        if math.dist(turtle.drawn_to, (turtle.x, turtle.y)) >= _LEAST_STROKE_M:
            self._draw(turtle)
        return is_new

    def _slipping(self, turtle: Turtle, span_s: float) -> float:
        if self._slip is None:
            return 0.0
        turtle.slipping = self._slip.next(turtle.slipping, span_s)
        return turtle.slipping if turtle.linear or turtle.lateral else 0.0

    def _draw(self, turtle: Turtle) -> None:
        here = (turtle.x, turtle.y)
        if here != turtle.drawn_to and not turtle.pen.is_off:
            self._drawn += 1
            turtle.strokes.append(Stroke(self._drawn, turtle.drawn_to, here, turtle.pen))
        turtle.drawn_to = here


def _check_place(name: str, x: float, y: float, theta: float) -> None:
    if not (0 <= x <= SIDE_M and 0 <= y <= SIDE_M and math.isfinite(theta)):
        raise TurtleRefused(name, f"cannot be at {x:g}, {y:g}: the plane is 0 to {SIDE_M:.3f} m")


def _clamped(value: float) -> float:
    return min(SIDE_M, max(0.0, value))


def _wrapped(angle: float) -> float:
    return math.remainder(angle, 2 * math.pi)
