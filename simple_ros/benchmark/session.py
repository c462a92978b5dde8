"""What ``simple-ros bench`` does: ours beside bare asyncio programs, in turn, on this machine."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from simple_ros.benchmark.calling import OWN_CALLERS, one_call_run
from simple_ros.benchmark.calls import Calls
from simple_ros.benchmark.machine import machine_facts
from simple_ros.benchmark.peers import LIMITS, OURS, Peer
from simple_ros.benchmark.results import (
    call_table,
    first_message_table,
    noisy_lines,
    traffic_table,
)
from simple_ros.benchmark.running import Failure, Outcome, RunFailed, master, one_run
from simple_ros.benchmark.workloads import WORKLOADS, Workload

__all__ = ["BASELINE", "FULL", "QUICK", "Extent", "measure"]

BASELINE = "buffered"
_CALLERS = ("ours", "bare")


@dataclass(frozen=True, slots=True)
class Extent:
    """How much is measured.

    Attributes:
        rounds: At most so many.
        limit_s: No round begins that would end later than so many seconds after the start.
        workloads: With these, as often as the fraction says.
        calls: Of the service.
    """

    rounds: int
    limit_s: float
    workloads: dict[str, float]
    calls: Calls


FULL = Extent(5, 600.0, {"small": 1.0, "latency": 1.0, "mib": 1.0, "image30": 1.0}, Calls())
QUICK = Extent(
    3,
    17.0,
    {"small": 0.3, "latency": 0.2, "mib": 0.3},
    Calls(count=500, paced=200, pipelined=5000),
)


def peers_for(transports: Sequence[str]) -> list[Peer]:
    """Ours over these transports, and the limits; without any, over TCP and as nodes choose on one host."""
    if not transports:
        chosen = replace(
            OURS["ours"],
            name="ours_host",
            what="simple_ros, as nodes of one host talk",
            options={},
        )
        return [OURS["ours"], chosen, LIMITS[BASELINE]]
    ours = [
        replace(
            OURS["ours"],
            name=f"ours_{transport}",
            what=f"simple_ros, {transport}",
            options={"transport": transport},
        )
        for transport in transports
    ]
    return [*ours, LIMITS[BASELINE]]


class _Session:
    def __init__(self, peers: Sequence[Peer], extent: Extent, tell: Callable[[str], None]) -> None:
        self.peers = peers
        self.extent = extent
        self.tell = tell
        self.workloads = [
            WORKLOADS[name].shortened(fraction) for name, fraction in extent.workloads.items()
        ]
        self.outcomes: dict[tuple[str, str], list[Outcome | None]] = {}
        self.failures: list[Failure] = []

    async def run(self) -> int:
        """All rounds; how many there were."""
        begun, longest = time.monotonic(), 0.0
        async with master() as address:
            for number in range(self.extent.rounds):
                start = time.monotonic()
                if number and start - begun + longest > self.extent.limit_s:
                    return number
                await self._round(number, {"master": address})
                longest = max(longest, time.monotonic() - start)
        return self.extent.rounds

    async def _round(self, number: int, services: dict[str, str]) -> None:
        for workload in self.workloads:
            # Each peer is the first of a round now and then.
            shift = number % len(self.peers)
            for peer in [*self.peers[shift:], *self.peers[:shift]]:
                self.tell(f"round {number + 1}: {workload.title}, {peer.what}")
                await self._note(workload.name, peer, one_run(peer, workload, services))
        for name in _CALLERS:
            caller = OWN_CALLERS[name]
            self.tell(f"round {number + 1}: service calls, {caller.what}")
            await self._note("calls", caller, one_call_run(caller, self.extent.calls, services))

    async def _note(self, what: str, peer: Any, run: Any) -> None:
        outcome: Outcome | None = None
        try:
            outcome = await run
        except RunFailed as error:
            self.failures.append(Failure(peer.name, what, str(error)))
        self.outcomes.setdefault((what, peer.name), []).append(outcome)

    def tables(self) -> dict[str, Any]:
        """All tables by name."""
        ours = self.peers[0].name
        tables = {workload.name: self._table(workload, ours) for workload in self.workloads}
        firsts = {peer.name: self.outcomes["latency", peer.name] for peer in self.peers}
        tables["first"] = first_message_table(self.peers, firsts, ours, BASELINE)
        calls = {name: self.outcomes["calls", name] for name in _CALLERS}
        whats = {name: ("ours", OWN_CALLERS[name].what) for name in _CALLERS}
        for measured in ("sequential_p50_us", "pipelined_per_second"):
            tables[f"calls_{measured}"] = call_table(measured, whats, calls, "ours")
        return tables

    def _table(self, workload: Workload, ours: str) -> dict[str, Any]:
        found = {peer.name: self.outcomes[workload.name, peer.name] for peer in self.peers}
        return traffic_table(workload, self.peers, found, ours, BASELINE)


async def measure(
    extent: Extent, transports: Sequence[str], tell: Callable[[str], None]
) -> dict[str, Any]:
    """Run everything.

    Args:
        extent: How much.
        transports: Of our nodes; none means TCP, and what nodes of one host choose.
        tell: Told what is under way.

    Returns:
        ``machine``, ``rounds``, ``tables`` by name, ``warnings`` and ``failures``.

    Raises:
        RunFailed: No Master starts.
    """
    machine = machine_facts()
    session = _Session(peers_for(transports), extent, tell)
    count = await session.run()
    tables = session.tables()
    failures = [
        f"{failure.peer}, {failure.workload}: {failure.reason}" for failure in session.failures
    ]
    return {
        "machine": machine,
        "rounds": count,
        "tables": tables,
        "warnings": noisy_lines(tables, machine, count),
        "failures": failures,
    }
