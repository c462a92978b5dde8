"""Maps with obstacles and places where the radio does not reach. SIMULATED."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["CoverageSettings", "random_map"]


@dataclass(frozen=True, slots=True)
class CoverageSettings:
    """Parameters of a map.

    Attributes:
        size: Cells along each side.
        resolution_m: Edge of a cell.
        obstacles: Rectangles that stand about.
        obstacle_cells: Least and largest side of one.
        dead_zones: Round places without coverage on and near the straight way.
        dead_radius_cells: Least and largest radius of one.
        base: Quality far from dead zones, least and largest.
        dead: Quality in the middle of a dead zone, least and largest.
    """

    size: int = 120
    resolution_m: float = 0.25
    obstacles: int = 14
    obstacle_cells: tuple[int, int] = (4, 14)
    dead_zones: int = 2
    dead_radius_cells: tuple[int, int] = (8, 16)
    base: tuple[float, float] = (0.55, 0.9)
    dead: tuple[float, float] = (0.02, 0.15)


def random_map(
    generator: np.random.Generator, settings: CoverageSettings
) -> tuple[NDArray[np.int8], NDArray[np.float64], tuple[int, int], tuple[int, int]]:
    """Cells (0 free, 100 occupied), quality by cell, start and goal (column, row)."""
    size = settings.size
    cells = np.zeros((size, size), np.int8)
    start, goal = (6, size // 2), (size - 7, size // 2)
    for _ in range(settings.obstacles):
        width, height = generator.integers(*settings.obstacle_cells, 2)
        x, y = generator.integers(14, size - 28), generator.integers(0, size - 4)
        cells[y : y + height, x : x + width] = 100
    rows, columns = np.mgrid[0:size, 0:size]
    tilt = generator.uniform(*settings.base, 4)
    u, v = columns / size, rows / size
    low, high = tilt[0] * (1 - u) + tilt[1] * u, tilt[2] * (1 - u) + tilt[3] * u
    quality = low * (1 - v) + high * v
    for _ in range(settings.dead_zones):
        radius = generator.uniform(*settings.dead_radius_cells)
        middle_x = generator.uniform(0.3, 0.7) * size
        middle_y = size / 2 + generator.normal(0, radius / 2)
        depth = generator.uniform(*settings.dead)
        distance = np.hypot(columns - middle_x, rows - middle_y)
        # Full depth inside, back to normal within four cells behind the edge.
        share = np.clip((distance - radius) / 4, 0, 1)
        quality = quality * share + depth * (1 - share)
    return cells, quality, start, goal
