"""Runs the programs of `calls`, a server and a client at a time."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from simple_ros.benchmark.calls import Calls
from simple_ros.benchmark.running import Child, Outcome

__all__ = ["OWN_CALLERS", "Caller", "one_call_run"]

_START_LIMIT_S = 20.0
_LIMIT_S = 60.0


@dataclass(frozen=True, slots=True)
class Caller:
    """Whose services are measured.

    Attributes:
        name: What it is called in tables.
        what: What it is, in words.
        command: The program and its kind; role and calls follow.
        services: What must run beside it.
        missing: Why it cannot run here; empty if it can.
    """

    name: str
    what: str
    command: tuple[str, ...]
    services: tuple[str, ...] = ()
    missing: str = ""


_PROGRAM = (sys.executable, "-m", "simple_ros.benchmark.calls")
OWN_CALLERS = {
    caller.name: caller
    for caller in (
        Caller("ours", "simple_ros, asyncio face", (*_PROGRAM, "ours"), ("master",)),
        Caller(
            "ours_blocking", "simple_ros, blocking face", (*_PROGRAM, "ours_blocking"), ("master",)
        ),
        Caller("bare", "bare asyncio protocol, TCP", (*_PROGRAM, "bare")),
    )
}


async def one_call_run(
    caller: Caller, calls: Calls, services: Mapping[str, str], cores: Sequence[int] = ()
) -> Outcome:
    """One server, one client, from their start to their end.

    Args:
        caller: Whose programs.
        calls: How many.
        services: Where what they need is.
        cores: That of the server and that of the client; none leaves it to the system.

    Raises:
        RunFailed: One of them ended or hung.
    """
    if "master" in caller.services:
        calls = replace(calls, master=services["master"])
    children: list[Child] = []
    try:
        server = await Child.start(
            (*_pinned(cores[:1]), *caller.command, "server", calls.as_json()), "server"
        )
        children.append(server)
        at = await server.said("ready", _START_LIMIT_S)
        client = await Child.start(
            (*_pinned(cores[1:]), *caller.command, "client", calls.with_server(str(at)).as_json()),
            "client",
        )
        children.append(client)
        report: Outcome = await client.said("report", _LIMIT_S)
        return report
    finally:
        await asyncio.gather(*(child.kill() for child in children))


def _pinned(cores: Sequence[int]) -> tuple[str, ...]:
    return ("taskset", "-c", str(cores[0])) if cores else ()
