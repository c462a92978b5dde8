"""All measurements, in one command: ``python benchmarks/run.py [NAME ...]``.

``latency``   one-way latency at 1 kHz                     ``calls``  calls of a service
``small``     small messages flat out                      ``rest``   CPU and memory when little happens
``mib``       1 MiB flat out                               ``start``  import times
``mib30``     1 MiB at 30 Hz (only when named)             ``scale``  one Master with 2,000 topics
``image30``   6.2 MB (1080p) at 30 Hz
``fanout``    one publisher, 8 subscriber processes

Ours, bare programs as limits, and every rival that ``benchmarks/peers_install.py`` has installed, take turns in one
interleaved run; those that are not installed are listed with the reason. Each round runs everybody once and
begins with another. Figures are medians of the rounds, ratios those of ours and theirs in the same round. Only
ratios travel between machines.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import sys
import time
from pathlib import Path
from typing import Any

import plots
import rest
import scale
import tables
from rivals_table import rival_callers, rivals, servers, versions

from simple_ros.benchmark.calling import OWN_CALLERS, Caller, one_call_run
from simple_ros.benchmark.calls import Calls
from simple_ros.benchmark.machine import machine_facts
from simple_ros.benchmark.peers import LIMITS, OURS, Peer
from simple_ros.benchmark.results import (
    call_table,
    first_message_table,
    noisy_lines,
    traffic_table,
)
from simple_ros.benchmark.running import Failure, RunFailed, master, one_run
from simple_ros.benchmark.workloads import WORKLOADS, Workload

BASELINE = "buffered"
TRAFFIC = ["latency", "small", "mib", "image30", "fanout"]
SINGLE = {"rest": rest.measure_all, "start": rest.measure_start, "scale": scale.measure_all}
DEFAULT = [*TRAFFIC, "calls", *SINGLE]
PLACES = {"free": (), "apart": (0, 1), "together": (0, 0)}
ONLY_WHEN_NAMED = {"rclpy_jazzy"}


class Run:
    """One interleaved run."""

    def __init__(self, args: argparse.Namespace, peers: list[Peer], callers: list[Caller]) -> None:
        self.rounds: int = args.rounds
        self.workloads = [
            WORKLOADS[name].shortened(args.fraction) for name in args.names if name in WORKLOADS
        ]
        self.peers = [peer for peer in peers if not peer.missing]
        self.callers = [caller for caller in callers if not caller.missing]
        self.calls = Calls() if "calls" in args.names else None
        self.cores = PLACES[args.place]
        self.found: dict[tuple[str, str], list[dict[str, float] | None]] = {}
        self.failures: list[Failure] = []

    def plan(self) -> list[tuple[str, Peer | Caller, Workload | None]]:
        """What a round consists of."""
        planned: list[tuple[str, Peer | Caller, Workload | None]] = [
            (workload.name, peer, workload)
            for workload in self.workloads
            for peer in self.peers
            if peer.takes(workload.name)
        ]
        if self.calls is not None:
            planned += [("calls", caller, None) for caller in self.callers]
        return planned

    async def go(self) -> None:
        plan = self.plan()
        wanted = {service for _, peer, _ in plan for service in peer.services}
        async with servers(wanted) as others, master() as address:
            services = others | {"master": address}
            for number in range(self.rounds):
                # Each workload stays together, so that the peers of one are near in time; who begins changes.
                for name in dict.fromkeys(name for name, _, _ in plan):
                    turn = [item for item in plan if item[0] == name]
                    shift = number * len(turn) // self.rounds
                    for _, peer, workload in [*turn[shift:], *turn[:shift]]:
                        progress(f"round {number + 1} of {self.rounds}: {name}, {peer.name}")
                        await self._one(name, peer, workload, services)
        progress("")

    async def _one(
        self, name: str, peer: Peer | Caller, workload: Workload | None, services: dict[str, str]
    ) -> None:
        outcomes = self.found.setdefault((name, peer.name), [])
        outcome = None
        if outcomes.count(None) < 2:  # who failed twice is asked no more
            try:
                if isinstance(peer, Caller):
                    assert self.calls is not None
                    outcome = await one_call_run(peer, self.calls, services, self.cores)
                else:
                    assert workload is not None
                    outcome = await one_run(peer, workload, services)
            except RunFailed as error:
                self.failures.append(Failure(peer.name, name, str(error)))
        outcomes.append(outcome)

    def tables(self) -> dict[str, Any]:
        made: dict[str, Any] = {}
        for workload in self.workloads:
            peers = [peer for peer in self.peers if peer.takes(workload.name)]
            found = {peer.name: self.found[workload.name, peer.name] for peer in peers}
            made[workload.name] = traffic_table(workload, peers, found, "ours", BASELINE)
            if workload.name == "latency":
                made["first"] = first_message_table(peers, found, "ours", BASELINE)
        if self.calls is not None:
            whats = {caller.name: (_group(caller), caller.what) for caller in self.callers}
            found = {name: self.found["calls", name] for name in whats}
            for measure in ("sequential_p50_us", "pipelined_per_second"):
                made[f"calls_{measure}"] = call_table(measure, whats, found, "ours")
        return made


def _group(caller: Caller) -> str:
    if caller.name not in OWN_CALLERS:
        return "rival"
    return "limit" if caller.name == "bare" else "ours"


def progress(text: str) -> None:
    if sys.stderr.isatty():
        sys.stderr.write(f"\r\x1b[K{text}")
        sys.stderr.flush()
    elif text:
        print(text, file=sys.stderr, flush=True)


def chosen(everybody: dict[str, Any], args: argparse.Namespace) -> list[Any]:
    """Those that were asked for; ours and the baseline always, since the others are compared with them."""
    if args.peers:
        kept = {"ours", BASELINE, "bare", *args.peers}
    else:
        kept = set(everybody) - ONLY_WHEN_NAMED
    return [peer for name, peer in everybody.items() if name in kept - set(args.without)]


def measure(args: argparse.Namespace) -> dict[str, Any]:
    everybody = OURS | LIMITS | rivals()
    callers = OWN_CALLERS | rival_callers()
    unknown = {*args.peers, *args.without} - set(everybody) - set(callers)
    if unknown:
        raise SystemExit(f"no such peer: {', '.join(unknown)}; --list shows them")
    begun = time.monotonic()
    peers, asked = chosen(everybody, args), chosen(callers, args)
    document: dict[str, Any] = {
        "machine": machine_facts(),
        "rounds": args.rounds,
        "rivals": versions(),
        "missing": {
            peer.name: peer.missing
            for peer in {p.name: p for p in [*peers, *asked]}.values()
            if peer.missing
        },
    }
    run = Run(args, peers, asked)
    asyncio.run(run.go())
    document["tables"] = run.tables()
    document["failures"] = [
        {"peer": failure.peer, "workload": failure.workload, "reason": failure.reason}
        for failure in run.failures
    ]
    document["warnings"] = noisy_lines(document["tables"], document["machine"], args.rounds)
    for name in args.names:
        if name in SINGLE:
            progress(name)
            document[name] = SINGLE[name](args.seconds, run.peers)
    progress("")
    document["bars"] = tables.bars(document)
    document["took_s"] = round(time.monotonic() - begun)
    return document


def listed() -> None:
    for name, peer in (OURS | LIMITS | rivals()).items():
        print(
            f"{name:<16}{peer.group:<7}{peer.what}{f'  [{peer.missing}]' if peer.missing else ''}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="default: all but mib30")
    parser.add_argument("--rounds", type=int, default=3, help="default: 3; 5 for figures to keep")
    parser.add_argument("--peers", nargs="*", default=[], metavar="PEER", help="only these")
    parser.add_argument("--without", nargs="*", default=[], metavar="PEER", help="all but these")
    parser.add_argument("--fraction", type=float, default=1.0, help="of the messages")
    parser.add_argument(
        "--seconds", type=float, default=20.0, help="how long 'rest' looks; 60 to keep"
    )
    parser.add_argument(
        "--place",
        choices=PLACES,
        default="free",
        help="the processes of 'calls': a core each, one core, or free",
    )
    parser.add_argument("--json", type=Path, help="write everything here")
    parser.add_argument("--from-json", type=Path, help="measure nothing, show this file")
    parser.add_argument("--markdown", type=Path, help="write the tables here")
    parser.add_argument("--plots", type=Path, metavar="DIRECTORY", help="write SVG plots here")
    parser.add_argument(
        "--docs", type=Path, metavar="PAGE", help="put tables and plots into docs/benchmarks.md"
    )
    parser.add_argument("--list", action="store_true", help="list the peers and end")
    args = parser.parse_args()
    if args.list:
        listed()
        return
    args.names = args.names or DEFAULT
    unknown = set(args.names) - {*WORKLOADS, "calls", *SINGLE}
    if unknown:
        parser.error(f"unknown: {', '.join(unknown)}")
    document = json.loads(args.from_json.read_text()) if args.from_json else measure(args)
    text = tables.markdown(document)
    print(text)
    if args.json:
        args.json.write_text(json.dumps(document, indent=1) + "\n")
    if args.markdown:
        args.markdown.write_text(text + "\n")
    if args.plots:
        plots.write(document, args.plots)
    if args.docs:
        written = plots.write(document, args.docs.parent / "plots")
        images = {path.stem: f"plots/{path.name}" for path in written}
        page = tables.into_page(args.docs.read_text(), document, images)
        args.docs.write_text(page)


if __name__ == "__main__":
    main()
