"""``simple-ros diag``: how the components are."""

from __future__ import annotations

import asyncio
import time
from enum import Enum
from typing import TYPE_CHECKING, Annotated

import typer

from simple_ros.cli.live import Place
from simple_ros.cli.log import printable
from simple_ros.cli.options import CountOption, JsonOption, MasterOption
from simple_ros.cli.text import columns, json_line, one_line, say
from simple_ros.cli.topic.following import cli_node, while_running

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.table import Table

    from simple_ros.diagnostics.aggregator import Aggregator, Item
    from simple_ros.node import NodeHandle

__all__ = ["command", "items_json", "items_text"]

_REPORT_S = 1.0
_TITLES = ("level", "name", "message", "age")
_COLOURS = {"warn": "yellow", "error": "red", "stale": "dim"}


class Least(Enum):
    """From which level on a status is shown."""

    OK = "ok"
    WARN = "warn"
    ERROR = "error"
    STALE = "stale"


def command(
    level: Annotated[Least, typer.Option(help="From this level on.")] = Least.OK,
    filter_text: Annotated[
        str, typer.Argument(metavar="[FILTER]", help="Only names that contain this.")
    ] = "",
    stale: Annotated[
        float, typer.Option("--stale", metavar="SECONDS", help="Stale when not heard for so long.")
    ] = 5.0,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="With the facts.")] = False,
    count: CountOption = None,
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Show once a second how the components are, the worst first, until Ctrl-C.

    A table in a terminal, lines elsewhere.
    """
    from simple_ros import aio
    from simple_ros.diagnostics.aggregator import Aggregator

    gathered = Aggregator(stale_after_s=stale)

    def items() -> list[Item]:
        least = list(Least).index(level)
        found = [
            item
            for item in gathered.items(time.monotonic())
            if item.level >= least and filter_text in item.status.name
        ]
        return sorted(found, key=lambda item: (-item.level, item.status.name))

    def show(place: Place) -> None:
        now = items()
        if json:
            say(items_json(now))
        else:
            place.show(lambda: items_text(now, verbose) + "\n", lambda: _table(now, verbose))

    async def watch() -> None:
        async with cli_node("diag", master) as node:
            await _gather(node, gathered)
            with Place(live=not json) as place:
                await while_running(node, _report(lambda: show(place), count))

    aio.run(watch())


async def _gather(node: NodeHandle, gathered: Aggregator) -> None:
    from simple_ros.msg.diagnostic_msgs import DiagnosticArray
    from simple_ros.qos import QosProfile, Reliability

    await node.subscribe(
        "/diagnostics",
        DiagnosticArray,
        lambda array: gathered.receive(array, time.monotonic()),
        qos=QosProfile(depth=1000, reliability=Reliability.BEST_EFFORT),
    )


async def _report(show: Callable[[], None], count: int | None) -> None:
    left = count
    while True:
        await asyncio.sleep(_REPORT_S)
        show()
        if left is not None and (left := left - 1) == 0:
            return


def items_json(items: list[Item]) -> str:
    """All statuses as JSON in one line."""
    from simple_ros.diagnostics.status import level_name

    return json_line(
        [
            {
                "level": level_name(item.level),
                "name": item.status.name,
                "message": item.status.message,
                "hardware_id": item.status.hardware_id,
                "age_s": item.age_s,
                "values": {value.key: value.value for value in item.status.values},
            }
            for item in items
        ]
    )


def _row(item: Item) -> tuple[str, ...]:
    from simple_ros.diagnostics.status import level_name

    name, message = item.status.name, one_line(item.status.message)
    return (level_name(item.level), printable(name), printable(message), f"{item.age_s:.1f} s")


def _facts(item: Item) -> list[str]:
    return [
        f"{printable(value.key)}: {printable(one_line(value.value))}"
        for value in item.status.values
    ]


def items_text(items: list[Item], verbose: bool) -> str:
    """All statuses as lines, with their facts below if wanted."""
    if not items:
        return "no diagnostics"
    lines = columns([_TITLES, *map(_row, items)]).splitlines()
    if not verbose:
        return "\n".join(lines)
    shown = lines[:1]
    for line, item in zip(lines[1:], items, strict=True):
        shown += [line, *(f"       {fact}" for fact in _facts(item))]
    return "\n".join(shown)


def _table(items: list[Item], verbose: bool) -> Table:
    from rich.table import Table
    from rich.text import Text

    table = Table(*_TITLES, box=None, pad_edge=False)
    for item in items:
        row = _row(item)
        style = _COLOURS.get(row[0], "")
        table.add_row(*(Text(cell, style=style) for cell in row))
        for fact in _facts(item) if verbose else ():
            table.add_row("", Text(f"  {fact}", style="dim"))
    if not items:
        table.add_row("", "no diagnostics")
    return table
