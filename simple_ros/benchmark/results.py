"""From the outcomes of all runs to one document: medians, least, most, and ratios round by round. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from simple_ros.benchmark.figures import NOISY, Spread, noise, ratios
from simple_ros.benchmark.peers import Peer
from simple_ros.benchmark.workloads import Workload

__all__ = ["Rounds", "call_table", "first_message_table", "noisy_lines", "traffic_table"]

Rounds = Sequence[Mapping[str, float] | None]
"""What one peer reported, round by round; None where it failed."""

_BUSY = 0.5
_FEW = 3
_CALL_MEASURES = {
    "sequential_p50_us": ("one call after another, p50", "us"),
    "pipelined_per_second": ("100 calls at a time", "calls/s"),
}


def traffic_table(
    workload: Workload, peers: Sequence[Peer], found: Mapping[str, Rounds], ours: str, baseline: str
) -> dict[str, Any]:
    """One workload: what everybody reached.

    Args:
        workload: Which.
        peers: Those that were measured with it.
        found: Their reports by name.
        ours: Whose ratio to each of the others is told.
        baseline: Whose ratio from round to round shows how quiet the machine was.
    """
    measure = workload.measure
    rows = {
        peer.name: _row(found[peer.name], measure)
        | {
            "what": peer.what,
            "group": peer.group,
            "raw": peer.is_raw,
            "ours_to_it": _ratio(found.get(ours, ()), found[peer.name], measure),
        }
        for peer in peers
    }
    return {
        "title": workload.title,
        "measure": measure,
        "unit": workload.unit,
        "is_better_larger": workload.is_better_larger,
        "workload": asdict(workload),
        "peers": rows,
        "baseline": baseline,
        "noise": noise(_complete(found.get(baseline, ()), measure)),
    }


def first_message_table(
    peers: Sequence[Peer], found: Mapping[str, Rounds], ours: str, baseline: str
) -> dict[str, Any]:
    """From the start of a publisher's process to its first message in the subscriber's callback."""
    measured = [peer for peer in peers if not peer.is_raw and peer.name in found]
    rows = {
        peer.name: _row(found[peer.name], "first_ms")
        | {
            "what": peer.what,
            "group": peer.group,
            "raw": False,
            "ours_to_it": _ratio(found.get(ours, ()), found[peer.name], "first_ms"),
        }
        for peer in measured
    }
    return {
        "title": "process start to first message",
        "measure": "first_ms",
        "unit": "ms",
        "is_better_larger": False,
        "peers": rows,
        "baseline": baseline,
        "noise": noise(_complete(found.get(baseline, ()), "first_ms")),
    }


def call_table(
    measure: str, whats: Mapping[str, tuple[str, str]], found: Mapping[str, Rounds], ours: str
) -> dict[str, Any]:
    """Calls of a service: what everybody reached.

    Args:
        measure: ``sequential_p50_us`` or ``pipelined_per_second``.
        whats: Group and description of each peer by name.
        found: Their reports.
        ours: Whose ratio to the others is told.
    """
    title, unit = _CALL_MEASURES[measure]
    rows = {}
    for name, (group, what) in whats.items():
        if any(report and measure in report for report in found[name]):
            ratio = _ratio(found.get(ours, ()), found[name], measure)
            facts = {"what": what, "group": group, "raw": False, "ours_to_it": ratio}
            rows[name] = _row(found[name], measure) | facts
    return {
        "title": f"service calls, {title}",
        "measure": measure,
        "unit": unit,
        "is_better_larger": not measure.endswith("_us"),
        "peers": rows,
        "baseline": "bare",
        "noise": noise(_complete(found.get("bare", ()), measure)),
    }


def noisy_lines(
    tables: Mapping[str, Mapping[str, Any]], machine: Mapping[str, Any], rounds: int
) -> list[str]:
    """Warnings: others use this machine, or a baseline moved too much from round to round."""
    lines = []
    if machine["load"] > machine["cores"] * _BUSY:
        lines.append(f"a load of {machine['load']} when it began: something else used this machine")
    if rounds < _FEW:
        lines.append(f"{rounds} rounds are too few to see how quiet this machine is")
    return lines + [
        f"{table['title']}: the bare baseline moved by a factor of {table['noise']:.2f} from round to "
        "round; trust the ratios more than the figures"
        for table in tables.values()
        if table["noise"] > NOISY
    ]


def _complete(reports: Rounds, measure: str) -> list[float]:
    return [report[measure] for report in reports if report and report.get(measure)]


def _ratio(ours: Rounds, theirs: Rounds, measure: str) -> dict[str, float] | None:
    found = ratios(
        [report.get(measure) if report else None for report in ours],
        [report.get(measure) if report else None for report in theirs],
    )
    return found.as_json() if found else None


def _row(reports: Rounds, measure: str) -> dict[str, Any]:
    came = [report for report in reports if report]
    keys = {key for report in came for key in report}
    figures = {
        key: Spread.of(values).as_json()
        for key in sorted(keys)
        if (values := [report[key] for report in came if key in report])
    }
    return {
        "value": Spread.of(values).as_json() if (values := _complete(reports, measure)) else None,
        "figures": figures,
        "rounds": [report.get(measure) if report else None for report in reports],
        "lost": round(sum(report.get("lost", 0) for report in came)),
    }
