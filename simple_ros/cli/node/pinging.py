"""``simple-ros node ping``."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Annotated

import typer

from simple_ros.cli.hosts import connect
from simple_ros.cli.lookup import address_text, find_node, node_json
from simple_ros.cli.measurements import spread
from simple_ros.cli.options import CountOption, JsonOption, MasterOption, NodeArgument
from simple_ros.cli.text import json_line, say

if TYPE_CHECKING:
    from simple_ros.rpc import ros_rpc_pb2 as ros

__all__ = ["ping", "ping_summary"]


def ping(
    node: NodeArgument,
    count: CountOption = None,
    interval: Annotated[float, typer.Option(min=0.0, help="Seconds between two.")] = 1.0,
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Measure how long it takes to connect to a node's port, until Ctrl-C.

    Code 1: nobody listened each time of -n.
    """
    from simple_ros import aio

    times: list[float | None] = []

    async def main() -> None:
        from simple_ros.net.master_client import MasterClient

        async with MasterClient(master) as client:
            info = (await find_node(client, node)).node_info
        while True:
            taken_ms, problem = await connect(info.ip, info.port)
            times.append(taken_ms)
            say(
                _ping_json(info, taken_ms, problem) if json else _ping_line(info, taken_ms, problem)
            )
            if len(times) == count:
                return
            await asyncio.sleep(interval)

    aio.run(main())
    if times and not json:
        say(ping_summary(times))
    if times and len(times) == count and not any(taken is not None for taken in times):
        raise typer.Exit(1)


def _ping_line(info: ros.NodeInfo, taken_ms: float | None, problem: str) -> str:
    result = problem if taken_ms is None else f"{taken_ms:.3f} ms"
    return f"{info.node_name} at {address_text(info)}: {result}"


def _ping_json(info: ros.NodeInfo, taken_ms: float | None, problem: str) -> str:
    result = {"listens": taken_ms is not None, "connect_ms": taken_ms, "problem": problem or None}
    return json_line(node_json(info) | result)


def ping_summary(times_ms: list[float | None]) -> str:
    """How many of the attempts were answered, and how fast."""
    answered = [taken for taken in times_ms if taken is not None]
    line = f"{len(answered)} of {len(times_ms)} answered"
    if not answered:
        return line
    found = spread(answered)
    return f"{line}: mean {found.mean:.3f} ms min {found.minimum:.3f} ms max {found.maximum:.3f} ms"
