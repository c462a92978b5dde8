"""Where the radio is good: a grid of link quality in the plane. Pure.

Cells are those of the navigation map: the same size, resolution, origin and turn. An index is the floor of
the quotient, so that a place just outside is outside. A robot writes only its own link's quality at its
own place.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simple_ros.errors import ConfigError

__all__ = ["UNKNOWN_PRIOR", "GridFrame", "QualityMap", "enhanced_cells"]

UNKNOWN_PRIOR = 0.5
"""Quality that an unknown cell counts with."""

Grid = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class GridFrame:
    """Where a grid lies.

    Attributes:
        width: Cells along its x.
        height: Cells along its y.
        resolution_m: Edge of a cell.
        origin_x_m: Corner of cell (0, 0), in the map frame.
        origin_y_m: The same.
        yaw_rad: Turn of the grid against the map frame, about the corner.
    """

    width: int
    height: int
    resolution_m: float
    origin_x_m: float = 0.0
    origin_y_m: float = 0.0
    yaw_rad: float = 0.0

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1 or not self.resolution_m > 0:
            raise ConfigError(f"{self}: width, height and resolution_m must be more than 0")

    def cell(self, x_m: float, y_m: float) -> tuple[int, int] | None:
        """Column and row of a place; None outside, and of what is no place."""
        if not (math.isfinite(x_m) and math.isfinite(y_m)):
            return None
        dx, dy = x_m - self.origin_x_m, y_m - self.origin_y_m
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        column = math.floor((cos * dx + sin * dy) / self.resolution_m)
        row = math.floor((-sin * dx + cos * dy) / self.resolution_m)
        inside = 0 <= column < self.width and 0 <= row < self.height
        return (column, row) if inside else None

    def centre(self, column: int, row: int) -> tuple[float, float]:
        """Place of the middle of a cell, m."""
        u, v = (column + 0.5) * self.resolution_m, (row + 0.5) * self.resolution_m
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return self.origin_x_m + cos * u - sin * v, self.origin_y_m + sin * u + cos * v


class QualityMap:
    """Quality of one link by place.

    Args:
        frame: Where the grid lies.
        alpha: Weight of a new sample in a cell.

    Attributes:
        quality: 0..1 by row and column, -1 where nobody has been.
        variance: Of the samples of a cell about their moving mean.
        count: Samples of each cell.
        updated_s: Time of each cell's newest sample; -inf where there is none.
    """

    def __init__(self, frame: GridFrame, alpha: float = 0.3) -> None:
        shape = (frame.height, frame.width)
        self.frame = frame
        self.quality: Grid = np.full(shape, -1.0)
        self.variance: Grid = np.zeros(shape)
        self.count: NDArray[np.int64] = np.zeros(shape, np.int64)
        self.updated_s: Grid = np.full(shape, -math.inf)
        self._alpha = alpha

    def update(self, x_m: float, y_m: float, quality: float, now_s: float) -> bool:
        """Take a sample; False if the place is outside, or the sample no number."""
        cell = self.frame.cell(x_m, y_m)
        if cell is None or not math.isfinite(quality):
            return False
        at = (cell[1], cell[0])
        old = float(self.quality[at])
        if old < 0:
            self.quality[at] = quality
        else:
            change = quality - old
            self.quality[at] = old + self._alpha * change
            kept = (1 - self._alpha) * (float(self.variance[at]) + self._alpha * change**2)
            self.variance[at] = kept
        self.count[at] += 1
        self.updated_s[at] = now_s
        return True

    def at(self, x_m: float, y_m: float) -> float | None:
        """Quality at a place; None where nobody has been, and outside."""
        cell = self.frame.cell(x_m, y_m)
        if cell is None:
            return None
        value = float(self.quality[cell[1], cell[0]])
        return value if value >= 0 else None

    def age_s(self, x_m: float, y_m: float, now_s: float) -> float | None:
        """How old the newest sample at a place is."""
        cell = self.frame.cell(x_m, y_m)
        if cell is None or not self.count[cell[1], cell[0]]:
            return None
        return now_s - float(self.updated_s[cell[1], cell[0]])

    def known_cells(self) -> int:
        """Cells with a sample."""
        return int(np.count_nonzero(self.count))

    def moved(self, frame: GridFrame) -> QualityMap:
        """The same knowledge in another frame, as when a navigation map grows; cell by cell."""
        other = QualityMap(frame, self._alpha)
        rows, columns = np.nonzero(self.count)
        for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
            there = frame.cell(*self.frame.centre(column, row))
            if there is not None:
                at, old = (there[1], there[0]), (row, column)
                other.quality[at] = self.quality[old]
                other.variance[at] = self.variance[old]
                other.count[at] = self.count[old]
                other.updated_s[at] = self.updated_s[old]
        return other

    def with_prior(self, prior: float = UNKNOWN_PRIOR) -> Grid:
        """Quality of all cells, unknown ones with a prior."""
        return np.where(self.quality < 0, prior, self.quality)

    def spread(self, samples: Sequence[tuple[float, float, float]], now_s: float) -> int:
        """Take many samples ``(x_m, y_m, quality)``; gives how many were inside."""
        return sum(self.update(x, y, quality, now_s) for x, y, quality in samples)


def enhanced_cells(cells: NDArray[np.int8], quality: Grid) -> NDArray[np.int8]:
    """A navigation map whose free cells cost more where the radio is worse.

    Free cells become ``(1 - q) 49``, rounded: 0 to 49. Unknown quality counts as `UNKNOWN_PRIOR`, so that
    a visited good place never costs more than one where nobody was. Obstacles, unknown and already weighted
    cells stay.

    Args:
        cells: 0..100 per cent occupied, -1 unknown, by row and column.
        quality: 0..1, -1 unknown; the same shape.
    """
    known = np.where(quality < 0, UNKNOWN_PRIOR, quality)
    cost = np.rint((1.0 - np.clip(known, 0.0, 1.0)) * 49).astype(np.int8)
    return np.where(cells == 0, cost, cells)
