"""What the measurements of single parts have in common: a Master of their own, medians and ratios, the machine."""

from __future__ import annotations

import statistics
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from simple_ros.benchmark.figures import ratios
from simple_ros.benchmark.machine import machine_facts
from simple_ros.benchmark.report import machine_line

LIMIT_S = 120


@contextmanager
def master() -> Iterator[str]:
    """A Master of its own; gives its address."""
    process = subprocess.Popen(
        [sys.executable, "-m", "simple_ros_master", "--port", "0"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        assert process.stdout is not None
        yield process.stdout.readline().rsplit(" ", 1)[1].strip()
    finally:
        process.terminate()
        process.wait(5)


def machine() -> str:
    return machine_line(machine_facts())


def median(reports: list[dict[str, Any]], field: str) -> float:
    return statistics.median(report[field] for report in reports)


def paired_ratio(
    ours: list[dict[str, Any]], theirs: list[dict[str, Any]], field: str
) -> tuple[float, float, float]:
    """Least, median and greatest of ours/theirs, round by round."""
    found = ratios([one[field] for one in ours], [one[field] for one in theirs])
    assert found is not None
    return found.least, found.median, found.most
