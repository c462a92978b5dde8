"""Runs peers as processes, several kinds in turn, and boils the runs down to medians."""

from __future__ import annotations

import json
import os
import platform
import statistics
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
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


def one_run(
    kind: str, count: int, rate: float, address: str, receivers: int = 1
) -> list[dict[str, Any]]:
    """One sender, one or more receivers; the receivers' reports."""
    peers = [sys.executable, str(HERE / "peers.py"), kind]
    common = ["--count", str(count), "--rate", str(rate), "--master", address]
    sinks = [
        subprocess.Popen(
            [*peers, "receive", *common, "--index", str(index)], stdout=subprocess.PIPE, text=True
        )
        for index in range(receivers)
    ]
    port = 0
    for sink in sinks:
        assert sink.stdout is not None
        port = json.loads(sink.stdout.readline())["ready"]
    sender = subprocess.Popen(
        [*peers, "send", *common, "--port", str(port), "--subscribers", str(receivers)]
    )
    try:
        reports = [json.loads(sink.communicate(timeout=LIMIT_S)[0]) for sink in sinks]
        sender.wait(LIMIT_S)
    finally:
        for process in [*sinks, sender]:
            process.kill()
    return reports


def interleaved(
    kinds: list[str], runs: int, count: int, rate: float = 0.0
) -> dict[str, list[dict[str, Any]]]:
    """``runs`` rounds, each kind once a round, so that a noisy moment hits all kinds alike."""
    results: dict[str, list[dict[str, Any]]] = {kind: [] for kind in kinds}
    with master() as address:
        for _ in range(runs):
            for kind in kinds:
                (report,) = one_run(kind, count, rate, address)
                if report["received"] != count:
                    raise SystemExit(f"{kind} lost messages: {report}")
                results[kind].append(report)
                print(".", end="", flush=True, file=sys.stderr)
    print(file=sys.stderr)
    return results


def median(reports: list[dict[str, Any]], field: str) -> float:
    return statistics.median(report[field] for report in reports)


def paired_ratio(
    ours: list[dict[str, Any]], theirs: list[dict[str, Any]], field: str
) -> tuple[float, float, float]:
    """Least, median and greatest of ours/theirs, round by round."""
    ratios = sorted(mine[field] / other[field] for mine, other in zip(ours, theirs, strict=True))
    return ratios[0], statistics.median(ratios), ratios[-1]


def machine() -> str:
    return (
        f"{os.cpu_count()} cores, {platform.system()} {platform.release()}, "
        f"CPython {platform.python_version()}, load {os.getloadavg()[0]:.1f}"
    )
