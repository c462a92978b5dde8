"""The turtles as the web page gets them: at first all lines, then what is new. Pure."""

from __future__ import annotations

from typing import Any

from simple_ros_engines.network_exposure.turtlesim.world import SIDE_M, World

__all__ = ["Picture"]

_MOST_STROKES = 2000


class Picture:
    """What one page has been sent, and what it needs next.

    Args:
        world: To show.
        background: Colour, parts of 0 to 255.
    """

    def __init__(self, world: World, background: tuple[int, int, int]) -> None:
        self._world = world
        self._background = background
        self._told = 0
        self._cleared = world.cleared
        self._names: set[str] = set()

    def state(self) -> dict[str, Any]:
        """The next state: all turtles, and pieces of line as x, y, x, y, r, g, b, width."""
        world = self._world
        is_new = self._cleared != world.cleared or bool(self._names - world.turtles.keys())
        if is_new:
            self._told, self._cleared = 0, world.cleared
        self._names = set(world.turtles)
        pieces = sorted(
            (stroke for _, stroke in world.strokes(self._told)), key=lambda stroke: stroke.number
        )[:_MOST_STROKES]
        if pieces:
            self._told = pieces[-1].number
        return {
            "side": SIDE_M,
            "background": self._background,
            "wipe": is_new,
            "turtles": [
                {
                    "name": turtle.name,
                    "x": round(turtle.x, 3),
                    "y": round(turtle.y, 3),
                    "theta": round(turtle.theta, 3),
                    "speed": round(turtle.linear, 3),
                    "wall": turtle.at_wall,
                }
                for turtle in world.turtles.values()
            ],
            "lines": [
                [
                    *(round(part, 3) for part in (*stroke.start, *stroke.end)),
                    stroke.pen.r,
                    stroke.pen.g,
                    stroke.pen.b,
                    stroke.pen.width,
                ]
                for stroke in pieces
            ],
        }
