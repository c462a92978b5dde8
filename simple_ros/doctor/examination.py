"""The whole examination: all looks at once, then the judges, in the order of the report."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar

from simple_ros.doctor.findings import Finding, warning
from simple_ros.doctor.judge_graph import (
    Master,
    Surroundings,
    judge_graph,
    judge_master,
    most_links,
)
from simple_ros.doctor.judge_host import judge_clock, judge_host
from simple_ros.doctor.judge_installation import judge_installation
from simple_ros.doctor.judge_network import (
    DEFAULT_PORT,
    judge_environment,
    judge_network,
    judge_ports,
)
from simple_ros.doctor.look_host import clock_difference, look_at_clock, look_at_host
from simple_ros.doctor.look_installation import installed_version, look_at_installation
from simple_ros.doctor.look_network import (
    look_at_environment,
    look_at_listeners,
    look_at_network,
)
from simple_ros.doctor.looking import Unknown, in_thread, within
from simple_ros.graph import GraphSnapshot
from simple_ros.net.addresses import split_address

__all__ = ["examine"]

Fact = TypeVar("Fact")

_LOOK_LIMIT_S = 2.5
_MASTER_LIMIT_S = 4.0


async def examine(master: str | None = None) -> list[Finding]:
    """Look at everything, within 5 s whatever hangs.

    Args:
        master: ``host:port``; None takes ``SIMPLE_ROS_MASTER`` or ``localhost:50051``.
    """
    before = clock_difference()
    environment = look_at_environment(master, os.environ)
    installation, network, ports, host, clock, around = await asyncio.gather(
        within(_LOOK_LIMIT_S, in_thread(look_at_installation)),
        within(_LOOK_LIMIT_S, in_thread(look_at_network, environment.master)),
        within(_LOOK_LIMIT_S, in_thread(look_at_listeners)),
        within(_LOOK_LIMIT_S, in_thread(look_at_host)),
        within(_LOOK_LIMIT_S, look_at_clock()),
        within(_MASTER_LIMIT_S, _look_around(environment.master)),
    )
    findings, graph, is_local = _judge_around(around)
    jump_s = clock_difference() - before
    port = split_address(environment.master)[1] if is_local else DEFAULT_PORT
    return [
        *_judged("installation", installation, judge_installation),
        *judge_environment(environment),
        *_judged("network", network, judge_network),
        *_judged("ports", ports, lambda found: judge_ports(found, port)),
        *findings,
        *_judged(
            "clock",
            clock,
            lambda found: judge_clock(replace(found, jump_s=jump_s, is_master_local=is_local)),
        ),
        *_judged("host", host, lambda found: judge_host(found, most_links(graph))),
    ]


def _judged(
    check: str, fact: Fact | Unknown[Fact], judge: Callable[[Fact], list[Finding]]
) -> list[Finding]:
    if isinstance(fact, Unknown):
        return [warning(check, f"could not be examined: {fact.reason}")]
    return judge(fact)


async def _look_around(address: str) -> tuple[Master, Surroundings | Unknown[Surroundings]] | None:
    """The Master and its graph; None if there is no address to look at."""
    if not address:
        return None
    # Imported here: where gRPC or protobuf are broken, everything else can still be told.
    from simple_ros.doctor.look_graph import look_at_master

    return await look_at_master(address, installed_version())


def _judge_around(
    around: tuple[Master, Surroundings | Unknown[Surroundings]] | Unknown[Any] | None,
) -> tuple[list[Finding], GraphSnapshot, bool | None]:
    """Findings about the Master and its graph, the graph, and whether the Master is on this host."""
    empty = GraphSnapshot()
    if around is None:
        return [], empty, None
    if isinstance(around, Unknown):
        return [warning("master", f"could not be examined: {around.reason}")], empty, None
    master, found = around
    findings = judge_master(master)
    if isinstance(found, Unknown):
        if not master.problem:
            findings.append(warning("graph", f"could not be examined: {found.reason}"))
        return findings, empty, master.is_local
    findings += judge_graph(found)
    return findings, found.graph, master.is_local
