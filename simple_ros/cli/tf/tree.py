"""``simple-ros tf tree``."""

from __future__ import annotations

import asyncio
import json as jsons
from typing import TYPE_CHECKING, Annotated

import typer

from simple_ros.cli.options import JsonOption, MasterOption
from simple_ros.cli.text import columns, say
from simple_ros.cli.tf.observing import edge_cells, observation_json, observing
from simple_ros.cli.topic.following import while_running

if TYPE_CHECKING:
    from simple_ros.tf.observation import Observation

__all__ = ["tree"]

DurationOption = Annotated[
    float, typer.Option("--duration", min=0.0, metavar="SECONDS", help="How long to listen.")
]


def tree(
    duration: DurationOption = 1.0,
    json: JsonOption = False,
    dot: Annotated[bool, typer.Option("--dot", help="A graph for graphviz.")] = False,
    master: MasterOption = None,
) -> None:
    """Listen for a second and draw the tree of frames, with rates, ages and what is broken.

    Exit code 1 if no transform came.
    """
    from simple_ros import aio

    if json and dot:
        raise typer.BadParameter("--json and --dot exclude each other")
    aio.run(_tree(duration, json, dot, master))


async def _tree(duration_s: float, json: bool, dot: bool, master: str | None) -> None:
    from simple_ros.errors import SimpleRosError

    async with observing(master) as (node, observation, clock):
        await while_running(node, asyncio.sleep(duration_s))
        now_s = clock.now().seconds
    if json:
        say(observation_json(observation, now_s))
        return
    if not observation.edges(now_s):
        reasons = "".join(f"\n  {problem.text}" for problem in observation.problems(now_s))
        raise SimpleRosError(
            f"no transform came within {duration_s:g} s on 'tf' and 'tf_static'{reasons}"
        )
    say(_tree_dot(observation, now_s) if dot else _tree_text(observation, now_s))


def _tree_text(observation: Observation, now_s: float) -> str:
    problems = observation.problems(now_s)
    broken = {problem.frame for problem in problems}
    rows = [
        (f"{row.prefix}{row.frame}", *edge_cells(row.edge), "(!)" if row.frame in broken else "")
        for row in observation.rows(now_s)
    ]
    lines = [columns(rows)]
    lines += [f"(!) {problem.text}" for problem in problems]
    return "\n".join(lines)


def _tree_dot(observation: Observation, now_s: float) -> str:
    broken = {problem.frame for problem in observation.problems(now_s)}
    lines = ["digraph frames {"]
    for edge in observation.edges(now_s):
        label = jsons.dumps(" ".join(filter(None, edge_cells(edge))), ensure_ascii=False)
        colour = ", color=red" if edge.frame in broken else ""
        ends = f"{_quoted(edge.parent)} -> {_quoted(edge.frame)}"
        lines.append(f"  {ends} [label={label}{colour}];")
    return "\n".join([*lines, "}"])


def _quoted(name: str) -> str:
    return jsons.dumps(name, ensure_ascii=False)
