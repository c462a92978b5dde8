"""Ways that keep the radio: A* over length and coverage. Pure.

A step costs its length times ``1 + weight (1-q) + penalty max(0, (dead - q)/dead)``: bad coverage is longer,
dead zones are much longer. Straight length through the best cells is a lower bound of it, so A* (Hart, Nilsson,
Raphael, 1968) finds the cheapest way. Steps go to the eight neighbours, never across the corner of an obstacle.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from simple_ros_engines.cross_domain.quality_map import UNKNOWN_PRIOR, GridFrame, QualityMap

__all__ = ["DEAD_ZONE", "PathQuality", "PathWeights", "analyze_path", "plan", "plan_between"]

DEAD_ZONE = 0.3
"""Quality below which a robot counts as cut off."""

Cell = tuple[int, int]
_OCCUPIED = 65
_MOST_SAMPLES = 10_000
_DIAGONAL = math.sqrt(2) - 1
_NEIGHBOURS = tuple(
    (dx, dy, math.hypot(dx, dy)) for dx in (-1, 0, 1) for dy in (-1, 0, 1) if dx or dy
)


@dataclass(frozen=True, slots=True)
class PathWeights:
    """What coverage is worth.

    Attributes:
        weight: Metres of detour per metre from the worst to the best coverage.
        penalty: On top in a dead zone.
        dead: Quality below which a zone is dead.
    """

    weight: float = 2.0
    penalty: float = 8.0
    dead: float = DEAD_ZONE


@dataclass(frozen=True, slots=True)
class PathQuality:
    """The radio along a path.

    Attributes:
        length_m: Of the path.
        mean: Quality, by length.
        minimum: The worst.
        dead_zone_m: Length below `DEAD_ZONE`.
        unknown_m: Length where nobody has measured.
    """

    length_m: float
    mean: float
    minimum: float
    dead_zone_m: float
    unknown_m: float


def analyze_path(
    points_m: Sequence[tuple[float, float]], quality: QualityMap, dead: float = DEAD_ZONE
) -> PathQuality:
    """Coverage along a path, sampled at half the map's resolution along each segment (at most 10,000 times).

    Unknown places and those outside count as `UNKNOWN_PRIOR`.
    """
    total = weighted = dead_m = unknown_m = 0.0
    minimum = 1.0
    for x, y, part_m in _samples(points_m, quality.frame.resolution_m / 2):
        found = quality.at(x, y)
        value = UNKNOWN_PRIOR if found is None else found
        total += part_m
        weighted += part_m * value
        minimum = min(minimum, value)
        dead_m += part_m if value < dead else 0.0
        unknown_m += part_m if found is None else 0.0
    mean = weighted / total if total else minimum
    return PathQuality(total, mean, minimum, dead_m, unknown_m)


def _samples(
    points_m: Sequence[tuple[float, float]], step_m: float
) -> Iterable[tuple[float, float, float]]:
    if len(points_m) == 1:
        yield (*points_m[0], 0.0)
    for (x0, y0), (x1, y1) in pairwise(points_m):
        length = math.hypot(x1 - x0, y1 - y0)
        count = max(1, math.ceil(min(_MOST_SAMPLES, length / step_m)))
        for index in range(count):
            at = (index + 0.5) / count
            yield x0 + at * (x1 - x0), y0 + at * (y1 - y0), length / count


def _step_costs(quality: NDArray[np.float64], weights: PathWeights) -> NDArray[np.float64]:
    value = np.clip(quality, 0.0, 1.0)
    dead = np.maximum(0.0, (weights.dead - value) / weights.dead)
    return np.asarray(1.0 + weights.weight * (1.0 - value) + weights.penalty * dead)


def plan(
    cells: NDArray[np.int8],
    quality: NDArray[np.float64],
    start: Cell,
    goal: Cell,
    weights: PathWeights | None = None,
) -> list[Cell] | None:
    """The cheapest way from cell to cell (column, row); None if there is none.

    Args:
        cells: Navigation map: 65 and more is occupied, -1 unknown and passable at no extra cost.
        quality: 0..1, no unknown ones left.
        start: Column and row.
        goal: Column and row.
        weights: What coverage is worth, none of it negative; all zero gives the shortest way.
    """
    height, width = cells.shape
    ends = (start, goal)
    if not all(0 <= column < width and 0 <= row < height for column, row in ends):
        return None
    free = cells < _OCCUPIED
    if not all(free[row, column] for column, row in ends):
        return None
    way = _Search(free, _step_costs(quality, weights or PathWeights())).way(start, goal)
    return None if way is None else list(way)


class _Search:
    """A* over cells that are numbered row by row, with an occupied border, so that no step leaves the map."""

    def __init__(self, free: NDArray[np.bool_], cost: NDArray[np.float64]) -> None:
        self._stride: int = free.shape[1] + 2
        self._free: list[bool] = np.pad(free, 1).ravel().tolist()
        self._cost: list[float] = np.pad(cost, 1).ravel().tolist()
        # No step costs less than that: the bound is as tight as a map that is bad everywhere allows.
        self._least = float(cost[free].min())
        self._steps = tuple(
            (dx + dy * self._stride, length / 2, dx if dx and dy else 0, dy * self._stride)
            for dx, dy, length in _NEIGHBOURS
        )

    def way(self, start: Cell, goal: Cell) -> Iterator[Cell] | None:
        """The cells of the cheapest way; None if there is none."""
        first, last = self._number(start), self._number(goal)
        came = {first: first}
        best = {first: 0.0}
        queue = [(self._bound(first, goal), first)]
        closed: set[int] = set()
        while queue:
            _, here = heappop(queue)
            if here == last:
                return self._walked(came, here)
            if here in closed:
                continue
            closed.add(here)
            for to, cost in self._around(here, best[here], closed):
                if cost < best.get(to, math.inf):
                    best[to] = cost
                    came[to] = here
                    heappush(queue, (cost + self._bound(to, goal), to))
        return None

    def _around(self, here: int, so_far: float, closed: set[int]) -> list[tuple[int, float]]:
        """Cells one step away, and what it costs to be there."""
        free, cost = self._free, self._cost
        own = cost[here]
        return [
            (here + step, so_far + half * (own + cost[here + step]))
            for step, half, aside, ahead in self._steps
            if free[here + step]
            and here + step not in closed
            and (not aside or (free[here + aside] and free[here + ahead]))
        ]

    def _bound(self, number: int, goal: Cell) -> float:
        """What the way from a cell costs at least: the shortest of eight directions, through the best cells."""
        dx = abs(number % self._stride - 1 - goal[0])
        dy = abs(number // self._stride - 1 - goal[1])
        return self._least * (max(dx, dy) + _DIAGONAL * min(dx, dy))

    def _number(self, cell: Cell) -> int:
        return cell[0] + 1 + (cell[1] + 1) * self._stride

    def _walked(self, came: dict[int, int], end: int) -> Iterator[Cell]:
        numbers = [end]
        while came[numbers[-1]] != numbers[-1]:
            numbers.append(came[numbers[-1]])
        return ((n % self._stride - 1, n // self._stride - 1) for n in reversed(numbers))


def plan_between(
    cells: NDArray[np.int8],
    quality: QualityMap,
    start_m: tuple[float, float],
    goal_m: tuple[float, float],
    weights: PathWeights | None = None,
) -> list[tuple[float, float]] | None:
    """As `plan`, between places in the map frame; keeps the exact ends."""
    frame: GridFrame = quality.frame
    start, goal = frame.cell(*start_m), frame.cell(*goal_m)
    if start is None or goal is None:
        return None
    way = plan(cells, quality.with_prior(), start, goal, weights)
    if way is None:
        return None
    inner = [frame.centre(*cell) for cell in _corners(way)[1:-1]]
    return [start_m, *inner, goal_m]


def _corners(way: list[Cell]) -> list[Cell]:
    """Without the cells inside straight runs."""
    kept = way[:1]
    for before, here, after in zip(way, way[1:], way[2:], strict=False):
        if (here[0] - before[0], here[1] - before[1]) != (after[0] - here[0], after[1] - here[1]):
            kept.append(here)
    return kept + way[-1:] if len(way) > 1 else kept
