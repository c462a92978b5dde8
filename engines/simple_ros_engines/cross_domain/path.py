"""Ways that keep the radio: A* over length and coverage. Pure.

A step costs its length times ``1 + weight (1-q) + penalty max(0, (dead - q)/dead)``: bad coverage is longer,
dead zones are much longer. Straight length is a lower bound of it, so A* (Hart, Nilsson, Raphael, 1968)
finds the cheapest way. Steps go to the eight neighbours, never across the corner of an obstacle.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from simple_ros_engines.cross_domain.quality_map import UNKNOWN_PRIOR, GridFrame, QualityMap

__all__ = ["DEAD_ZONE", "PathQuality", "PathWeights", "analyze_path", "plan", "plan_between"]

DEAD_ZONE = 0.3
"""Quality below which a robot counts as cut off."""

Cell = tuple[int, int]
_OCCUPIED = 65


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
    """Coverage along a path, sampled at half the map's resolution along each segment.

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
        count = max(1, math.ceil(length / step_m))
        for index in range(count):
            at = (index + 0.5) / count
            yield x0 + at * (x1 - x0), y0 + at * (y1 - y0), length / count


def _step_costs(quality: NDArray[np.float64], weights: PathWeights) -> list[list[float]]:
    value = np.clip(quality, 0.0, 1.0)
    dead = np.maximum(0.0, (weights.dead - value) / weights.dead)
    cost = 1.0 + weights.weight * (1.0 - value) + weights.penalty * dead
    rows: list[list[float]] = cost.tolist()
    return rows


_NEIGHBOURS = tuple(
    (dx, dy, math.hypot(dx, dy)) for dx in (-1, 0, 1) for dy in (-1, 0, 1) if dx or dy
)


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
        weights: What coverage is worth; all zero gives the shortest way.
    """
    free: list[list[bool]] = (cells < _OCCUPIED).tolist()
    step = _step_costs(quality, weights or PathWeights())
    height, width = cells.shape

    def inside_free(column: int, row: int) -> bool:
        return 0 <= column < width and 0 <= row < height and free[row][column]

    if not (inside_free(*start) and inside_free(*goal)):
        return None
    came: dict[Cell, Cell] = {}
    best = {start: 0.0}
    queue = [(_straight(start, goal), start)]
    closed: set[Cell] = set()
    while queue:
        _, here = heapq.heappop(queue)
        if here == goal:
            return _walked(came, here)
        if here in closed:
            continue
        closed.add(here)
        column, row = here
        so_far, here_cost = best[here], step[row][column]
        for dx, dy, length in _NEIGHBOURS:
            to = (column + dx, row + dy)
            if to in closed or not inside_free(*to):
                continue
            if dx and dy and not (free[row][to[0]] and free[to[1]][column]):
                continue
            cost = so_far + length * (here_cost + step[to[1]][to[0]]) / 2
            if cost < best.get(to, math.inf):
                best[to] = cost
                came[to] = here
                heapq.heappush(queue, (cost + _straight(to, goal), to))
    return None


def _straight(one: Cell, other: Cell) -> float:
    """Length of the shortest way of eight directions, in cells."""
    dx, dy = abs(one[0] - other[0]), abs(one[1] - other[1])
    return max(dx, dy) + (math.sqrt(2) - 1) * min(dx, dy)


def _walked(came: dict[Cell, Cell], end: Cell) -> list[Cell]:
    cells = [end]
    while cells[-1] in came:
        cells.append(came[cells[-1]])
    return cells[::-1]


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
