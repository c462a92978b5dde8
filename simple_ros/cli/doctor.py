"""``simple-ros doctor``: what is wrong here, and what to do about it."""

from __future__ import annotations

import asyncio
import sys
from typing import Annotated

import typer

from simple_ros.cli.options import JsonOption, MasterOption
from simple_ros.cli.text import json_line, say

__all__ = ["command"]

_COLOURS = {"warning": typer.colors.YELLOW, "error": typer.colors.RED}


def command(
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="Also tell what is in order.")
    ] = False,
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Examine this host, this installation, the Master and the nodes; takes a few seconds at most.

    Code 1: there are errors; warnings alone leave it 0.
    """
    # With nothing of the library that needs gRPC or protobuf: they may be what is broken.
    from simple_ros.doctor.examination import examine
    from simple_ros.doctor.findings import Level, report_json, report_lines, summary

    findings = asyncio.run(examine(master))
    if json:
        say(json_line(report_json(findings)))
    else:
        for level, line in report_lines(findings, verbose=verbose):
            say(_coloured(line, _COLOURS.get(level.value)))
        hint = "" if verbose else "; --verbose shows all"
        say(summary(findings) + hint)
    if any(finding.level is Level.ERROR for finding in findings):
        raise typer.Exit(1)


def _coloured(line: str, colour: str | None) -> str:
    return typer.style(line, fg=colour) if colour and sys.stdout.isatty() else line
