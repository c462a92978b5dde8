"""Ways with regard to coverage against shortest ways, and against the same A* with a linear cost alone.

SIMULATED maps. `python benchmarks/wireless/paths.py [--seeds 20]`
"""

from __future__ import annotations

import time
from functools import partial

import numpy as np
from common import Column, arguments, by_seed, print_parameters, print_table

from simple_ros_engines.cross_domain.path import PathWeights, analyze_path, plan
from simple_ros_engines.cross_domain.quality_map import GridFrame, QualityMap
from simple_ros_engines.simulator.coverage import CoverageSettings, random_map

SHORTEST = PathWeights(0.0, 0.0)
LINEAR = PathWeights(2.0, 0.0)


def one_seed(seed: int, settings: CoverageSettings) -> list[float]:
    cells, quality, start, goal = random_map(np.random.default_rng(seed), settings)
    grid = QualityMap(GridFrame(settings.size, settings.size, settings.resolution_m))
    grid.quality[:] = quality
    found = []
    for weights in (SHORTEST, LINEAR, PathWeights()):
        begun = time.perf_counter()
        way = plan(cells, quality, start, goal, weights)
        took = time.perf_counter() - begun
        assert way is not None, f"map {seed} has no way"
        found.append(analyze_path([grid.frame.centre(*cell) for cell in way], grid))
    short, linear, ours = found
    cut = lambda path: 100 * (1 - path.dead_zone_m / max(1e-9, short.dead_zone_m))  # noqa: E731
    longer = lambda path: 100 * (path.length_m / short.length_m - 1)  # noqa: E731
    return [
        ours.minimum / short.minimum,
        longer(ours),
        cut(ours),
        linear.minimum / short.minimum,
        longer(linear),
        cut(linear),
        1000 * took,
    ]


COLUMNS = [
    Column("ours, least quality against shortest", "times", min, "bar: >= 2"),
    Column("ours, longer by", "%", max, "bar: <= 25"),
    Column("ours, less way in dead zones", "%", min, "bar: >= 80"),
    Column("linear cost, least quality", "times", min),
    Column("linear cost, longer by", "%", max),
    Column("linear cost, less way in dead zones", "%", min),
    Column("ours, planning time", "ms", max),
]


def main() -> None:
    options = arguments(__doc__ or "")
    settings = CoverageSettings()
    print_parameters("paths (SIMULATED maps)", settings, PathWeights())
    rows = by_seed(partial(one_seed, settings=settings), options)
    print_table(COLUMNS, rows, options.verbose)


if __name__ == "__main__":
    main()
