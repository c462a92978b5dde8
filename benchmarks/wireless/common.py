"""What the measurements of the wireless engines share: seeds, tables, median and worst."""

from __future__ import annotations

import argparse
import statistics
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, is_dataclass
from typing import Any


def arguments(description: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--seeds", type=int, default=20, help="how many, from 1 up")
    parser.add_argument("--verbose", action="store_true", help="a line for each seed")
    return parser.parse_args()


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
