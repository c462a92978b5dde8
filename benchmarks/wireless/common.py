"""What the measurements of the wireless engines share: seeds, tables, median and worst."""

from __future__ import annotations

import argparse
import statistics
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, is_dataclass
from itertools import pairwise
from typing import Any

import numpy as np


def arguments(description: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--seeds", type=int, default=20, help="how many")
    parser.add_argument("--first", type=int, default=1, help="the first seed, to look at others")
    parser.add_argument("--verbose", action="store_true", help="a line for each seed")
    return parser.parse_args()


def by_seed(
    one_seed: Callable[[int], list[float]], options: argparse.Namespace
) -> list[list[float]]:
    """A row for each seed, on all cores."""
    with ProcessPoolExecutor() as pool:
        return list(pool.map(one_seed, range(options.first, options.first + options.seeds)))


def recent_means(series: np.ndarray, edges: Sequence[int]) -> np.ndarray:
    """Means of the newest samples between two ages, by sample and pair of edges, and a column of ones."""
    sums, here = np.cumsum(np.r_[0.0, series]), np.arange(series.size) + 1
    columns = []
    for young, old in pairwise(edges):
        end = np.maximum(1, here - young)
        begin = np.maximum(0, np.minimum(here - old, end - 1))
        columns.append((sums[end] - sums[begin]) / (end - begin))
    return np.stack([*columns, np.ones(series.size)], axis=1)


@dataclass(frozen=True)
class Column:
    """One number of each seed.

    Attributes:
        name: What it is.
        unit: Printed behind.
        worst: ``min`` or ``max``.
        bar: What the median must reach, and in which direction.
    """

    name: str
    unit: str
    worst: Callable[[Sequence[float]], float]
    bar: str = ""


def print_parameters(title: str, *items: Any, **values: Any) -> None:
    print(f"== {title}")
    for item in items:
        shown = asdict(item) if is_dataclass(item) and not isinstance(item, type) else item
        print(f"   {type(item).__name__}: {shown}")
    for name, value in values.items():
        print(f"   {name} = {value}")


def print_table(columns: Sequence[Column], rows: Sequence[Sequence[float]], verbose: bool) -> None:
    if verbose:
        print("   seed " + " ".join(f"{column.name:>22}" for column in columns))
        for seed, row in enumerate(rows, 1):
            print(f"   {seed:4d} " + " ".join(f"{value:22.4g}" for value in row))
    width = max(len(column.name) for column in columns)
    print(f"   {'':{width}}  {'median':>10} {'worst':>10}   ({len(rows)} seeds)")
    for index, column in enumerate(columns):
        values = [row[index] for row in rows]
        print(
            f"   {column.name:{width}}  {statistics.median(values):10.4g} "
            f"{column.worst(values):10.4g} {column.unit:6} {column.bar}"
        )
    print(flush=True)
