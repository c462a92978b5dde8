"""All measurements of the core, in one command: ``python benchmarks/run.py [NAME ...]``.

``small``    small messages flat out, zero loss: ours beside bare asyncio programs, interleaved
``blocking`` the same through the blocking face, beside the asyncio face
``latency``  one-way latency at 1 kHz, the same way
``scale``    200 nodes and 2,000 topics on one Master
``services`` calls of a service, beside other middleware that is installed (see ``services.py``)
``rest``     CPU of an idle node and of a 100 Hz publisher, user+system of the whole process, 60 s

Only ratios travel between machines; absolute figures are medians of ``--runs`` rounds (5 unless
said) with the bare baseline beside them.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
from pathlib import Path
from typing import Any

import harness
import rest
import scale
import services

STOCK_CPP_PER_SECOND = 900
"""Stock C++ simple_ros: one message, then 1 ms of sleep, so never more, on any machine."""
KINDS = ["ours", "unix", "bare", "tuned"]


def small(runs: int) -> dict[str, Any]:
    results = harness.interleaved(KINDS, runs, count=300_000)
    rates = {kind: harness.median(results[kind], "per_second") for kind in KINDS}
    table = [f"  {kind:<8}{rates[kind]:>12,.0f} msg/s" for kind in KINDS]
    ratios = {
        kind: harness.paired_ratio(results["ours"], results[kind], "per_second")
        for kind in ("bare", "tuned")
    }
    times = rates["ours"] / STOCK_CPP_PER_SECOND
    table += [
        f"  ours / bare asyncio         {_shown(ratios['bare'])}   bar: >= 0.6",
        f"  ours / tuned asyncio        {_shown(ratios['tuned'])}",
        f"  ours / stock C++ (900/s)    {times:.0f}   bar: >= 100",
    ]
    return {"table": table, "rates": rates, "ratios": ratios, "times_stock_cpp": times}


def blocking(runs: int) -> dict[str, Any]:
    kinds = ["ours", "blocking"]
    results = harness.interleaved(kinds, runs, count=300_000)
    rates = {kind: harness.median(results[kind], "per_second") for kind in kinds}
    ratio = harness.paired_ratio(results["blocking"], results["ours"], "per_second")
    table = [f"  {kind:<10}{rates[kind]:>12,.0f} msg/s" for kind in kinds]
    table.append(f"  blocking / asyncio face     {_shown(ratio)}   bar: >= 0.7")
    return {"table": table, "rates": rates, "ratio": ratio}


def latency(runs: int) -> dict[str, Any]:
    results = harness.interleaved(KINDS, runs, count=5_000, rate=1000)
    table = []
    medians: dict[str, Any] = {}
    for kind in KINDS:
        medians[kind] = {
            field: harness.median(results[kind], field) for field in ("p50_us", "p95_us", "p99_us")
        }
        table.append(
            f"  {kind:<8}p50 {medians[kind]['p50_us']:6.0f}  p95 {medians[kind]['p95_us']:6.0f}"
            f"  p99 {medians[kind]['p99_us']:6.0f} us"
        )
    ratios = {
        kind: harness.paired_ratio(results["ours"], results[kind], "p50_us")
        for kind in ("bare", "tuned")
    }
    table += [
        f"  ours / bare asyncio p50     {_shown(ratios['bare'])}   bar: <= 2",
        f"  ours / tuned asyncio p50    {_shown(ratios['tuned'])}",
    ]
    return {"table": table, "medians": medians, "ratios": ratios}


def _shown(ratio: tuple[float, float, float]) -> str:
    least, middle, most = ratio
    return f"{middle:5.2f} ({least:.2f} to {most:.2f})"


def scaled(runs: int) -> dict[str, Any]:
    rounds = [scale.measure() for _ in range(runs)]
    merged = {field: statistics.median(one[field] for one in rounds) for field in rounds[0]}
    table = [
        (
            f"  registration, first 200 of {merged['registrations']:,.0f}  "
            f"{merged['first_us']:7.0f} us each"
        ),
        f"  registration, last 200          {merged['last_us']:7.0f} us each",
        f"  last / first                    {merged['growth']:7.2f}   bar: flat",
        (
            f"  subscribe call to target known  {merged['push_p50_ms']:7.2f} ms p50, "
            f"{merged['push_p99_ms']:.2f} ms p99"
        ),
        (
            f"  Master memory                   {merged['rss_start_mb']:7.1f} MB empty, "
            f"{merged['rss_full_mb']:.1f} MB full"
        ),
    ]
    return {"table": table, **merged}


def at_rest(runs: int) -> dict[str, Any]:
    rounds = [rest.measure(60.0) for _ in range(max(1, runs // 5))]
    merged = {field: statistics.median(one[field] for one in rounds) for field in rounds[0]}
    table = [
        f"  idle node          {merged['idle_percent']:6.3f} % of a core   bar: < 0.2",
        f"  100 Hz publisher   {merged['publisher_percent']:6.3f} % of a core   bar: < 2",
        f"  100 Hz, bare loop  {merged['bare_percent']:6.3f} % of a core   (asyncio.sleep, sendall)",
        f"  Master             {merged['master_percent']:6.3f} % of a core",
        f"  idle node memory   {merged['idle_rss_mb']:6.1f} MB",
    ]
    return {"table": table, **merged}


BENCHMARKS = {
    "small": small,
    "blocking": blocking,
    "latency": latency,
    "scale": scaled,
    "services": services.measure,
    "rest": at_rest,
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("names", nargs="*", default=[], metavar="NAME", help="default: all")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    unknown = [name for name in args.names if name not in BENCHMARKS]
    if unknown:
        parser.error(f"unknown: {', '.join(unknown)}; there are {', '.join(BENCHMARKS)}")
    results: dict[str, Any] = {"machine": harness.machine(), "runs": args.runs}
    print(results["machine"])
    for name in args.names or BENCHMARKS:
        results[name] = BENCHMARKS[name](args.runs)
        print(f"{name}:", *results[name].pop("table"), sep="\n", flush=True)
    if args.json:
        args.json.write_text(json.dumps(results, indent=2) + "\n")
        print(f"written: {args.json}", file=sys.stderr)


if __name__ == "__main__":
    main()
