"""``simple-ros tf monitor``."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

from simple_ros.cli.live import Place
from simple_ros.cli.options import CountOption, JsonOption, MasterOption
from simple_ros.cli.text import columns, duration_text, say
from simple_ros.cli.tf.observing import edge_cells, observation_json, observing
from simple_ros.cli.topic.following import while_running

if TYPE_CHECKING:
    from rich.console import Group

    from simple_ros.tf.observation import Edge, Observation

__all__ = ["monitor"]

_REPORT_S = 1.0


def monitor(
    json: JsonOption = False, count: CountOption = None, master: MasterOption = None
) -> None:
    """Show once a second how transforms arrive: rate, delay and age of each frame, until Ctrl-C.

    A table in a terminal, lines elsewhere. Delay is arrival minus stamp.
    """
    from simple_ros import aio

    aio.run(_monitor(json, count, master))


async def _monitor(json: bool, count: int | None, master: str | None) -> None:
    async with observing(master) as (node, observation, clock):

        async def report() -> None:
            left = count
            with Place(live=not json) as place:
                while True:
                    await asyncio.sleep(_REPORT_S)
                    _show(place, observation, clock.now().seconds, json)
                    if left is not None and (left := left - 1) == 0:
                        return

        await while_running(node, report())


def _show(place: Place, observation: Observation, now_s: float, json: bool) -> None:
    if json:
        say(observation_json(observation, now_s))
    else:
        place.show(lambda: _monitor_text(observation, now_s), lambda: _table(observation, now_s))


_TITLES = ("frame", "parent", "rate", "delay", "max delay", "age")


def _monitor_rows(observation: Observation, now_s: float) -> list[tuple[str, ...]]:
    return [
        (
            edge.frame,
            edge.parent,
            edge_cells(edge)[0],
            *("" if value is None else duration_text(value) for value in _times(edge)),
        )
        for edge in observation.edges(now_s)
    ]


def _times(edge: Edge) -> tuple[float | None, ...]:
    return (edge.delay_s, edge.max_delay_s, edge.age_s)


def _monitor_text(observation: Observation, now_s: float) -> str:
    rows = _monitor_rows(observation, now_s)
    lines = [columns([_TITLES, *rows])] if rows else ["no transforms yet"]
    lines += [f"(!) {problem.text}" for problem in observation.problems(now_s)]
    return "\n".join(lines) + "\n"


def _table(observation: Observation, now_s: float) -> Group:
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False)
    for number, title in enumerate(_TITLES):
        table.add_column(title, justify="left" if number < 2 else "right")
    for row in _monitor_rows(observation, now_s):
        table.add_row(*map(Text, row))
    problems = [Text(f"(!) {problem.text}", style="red") for problem in observation.problems(now_s)]
    return Group(table, *problems)
