"""``simple-ros bag recover`` and ``doctor``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from simple_ros.cli.bag.arguments import InArgument, OutArgument, bag_files, counted
from simple_ros.cli.options import JsonOption
from simple_ros.cli.text import json_line, say, size_text

if TYPE_CHECKING:
    from simple_ros.bag.examination import Examination
    from simple_ros.bag.recovery import Recovery

__all__ = ["doctor", "recover"]

_SHOWN = 20


def recover(source: InArgument, target: OutArgument) -> None:
    """Save what is whole of a bag that is damaged, or whose recorder was killed.

    IN is not changed. Exit code 1 if a part of it could not be saved.
    """
    from simple_ros.bag.recovery import recover as recovered

    found = recovered(source, target)
    say(f"wrote {target}: {_amount(found)}")
    if not found.was_ended:
        say("the recording was not ended; what came after its last flush is not in it")
    for damage in found.damage[:_SHOWN]:
        print(f"warning: byte {damage.offset}: {damage.reason}", file=sys.stderr)
    if len(found.damage) > _SHOWN:
        print(f"warning: and {len(found.damage) - _SHOWN} more", file=sys.stderr)
    if found.lost_bytes:
        print(f"warning: {size_text(found.lost_bytes)} were not saved", file=sys.stderr)
        raise typer.Exit(1)


def doctor(
    files: Annotated[list[Path], typer.Argument(metavar="FILE", help="Bags, or directories.")],
    json: JsonOption = False,
) -> None:
    """Read every byte of a bag and tell what is not as it should be; exit code 1 if anything is."""
    from simple_ros.bag.examination import examine

    sick = False
    for path in bag_files(files):
        found = examine(path)
        sick = sick or bool(found.errors)
        if json:
            say(
                json_line(
                    {
                        "path": str(path),
                        "messages": found.messages,
                        "chunks": found.chunks,
                        "errors": [[item.offset, item.reason] for item in found.errors],
                        "warnings": [[item.offset, item.reason] for item in found.warnings],
                    }
                )
            )
            continue
        state = "not well" if found.errors else "well"
        say(f"{path}: {state}, {_amount(found)}")
        for word, items in (("error", found.errors), ("warning", found.warnings)):
            for item in items[:_SHOWN]:
                say(f"  {word}: byte {item.offset}: {item.reason}")
            if len(items) > _SHOWN:
                say(f"  and {len(items) - _SHOWN} more")
    if sick:
        raise typer.Exit(1)


def _amount(found: Recovery | Examination) -> str:
    return f"{counted(found.messages)} in {counted(found.chunks, 'chunk')}"
