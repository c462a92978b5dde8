"""``simple-ros bench``: how fast it is on this machine."""

from __future__ import annotations

import asyncio
import sys
from typing import Annotated, Any

import typer

from simple_ros.cli.options import JsonOption
from simple_ros.cli.text import json_line, say

__all__ = ["command"]


def command(
    quick: Annotated[bool, typer.Option("--quick", help="Less of everything, in 20 s.")] = False,
    transport: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Measure our nodes over this transport, tcp or unix, say; may be repeated.",
            show_default="tcp, and what nodes of one host choose",
        ),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Measure simple_ros on this machine, beside bare asyncio programs that do the same.

    Small messages, latency, large messages, first message and services, between two processes here; takes
    a minute or two. It starts a Master of its own and disturbs no other.

    Code 1: something could not be measured, or messages were lost.
    """
    from simple_ros.benchmark.peers import known_transports
    from simple_ros.benchmark.session import BASELINE, FULL, QUICK, measure

    wanted = tuple(dict.fromkeys(transport or ()))
    unknown = [name for name in wanted if name not in known_transports()]
    if unknown:
        raise typer.BadParameter(
            f"no transport {unknown[0]!r}; there are {', '.join(known_transports())}",
            param_hint="--transport",
        )
    found = asyncio.run(measure(QUICK if quick else FULL, wanted, _progress))
    _progress("")
    if json:
        say(json_line(found))
    else:
        say("\n".join(_lines(found, BASELINE)))
    lost = any(row["lost"] for table in found["tables"].values() for row in table["peers"].values())
    if found["failures"] or lost:
        raise typer.Exit(1)


def _progress(text: str) -> None:
    if sys.stderr.isatty():
        # Back to the beginning of the line, and away with what was there.
        sys.stderr.write(f"\r\x1b[K{text}")
        sys.stderr.flush()


def _lines(found: dict[str, Any], baseline: str) -> list[str]:
    from simple_ros.benchmark.report import machine_line, table_lines

    rounds = found["rounds"]
    lines = [
        machine_line(found["machine"]),
        f"Two processes on this host, medians of {rounds} round{'s' * (rounds > 1)} (least to most).",
        "Bare: the plainest asyncio program with the same messages; no topics, no queues, nobody to find.",
    ]
    for name, table in found["tables"].items():
        base = "bare" if name.startswith("calls_") else baseline
        lines += ["", *table_lines(table, base)]
    lines += [f"\nwarning: {line}" for line in found["warnings"]]
    lines += [f"\nerror: {line}" for line in found["failures"]]
    return lines
