"""``simple-ros node kill``: ask nodes to end, or send their processes a signal."""

from __future__ import annotations

import asyncio
import sys
from typing import TYPE_CHECKING, Annotated

import typer

from simple_ros.cli.completion import complete_nodes
from simple_ros.cli.lookup import find_node
from simple_ros.cli.node.ending import Outcome, ask_to_end, end_processes, wait_until_unlisted
from simple_ros.cli.options import JsonOption, MasterOption
from simple_ros.cli.text import json_line, say

if TYPE_CHECKING:
    from simple_ros.net.master_client import MasterClient
    from simple_ros.rpc import ros_rpc_pb2 as ros

__all__ = ["kill"]


def kill(
    nodes: Annotated[
        list[str] | None,
        typer.Argument(metavar="NODE", help="Names of the nodes.", autocompletion=complete_nodes),
    ] = None,
    every: Annotated[bool, typer.Option("--all", help="Every node that is listed.")] = False,
    timeout: Annotated[
        float, typer.Option(min=0.1, metavar="SECONDS", help="How long they may take.")
    ] = 3.0,
    signal: Annotated[
        bool,
        typer.Option(
            "--signal",
            help="Send SIGTERM to C++ nodes of this host, which cannot be asked.",
        ),
    ] = False,
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Ask nodes to end, and wait until they have.

    Code 1: not all of them have ended. An unknown name ends none.
    """
    from simple_ros import aio

    if every == bool(nodes):
        raise typer.BadParameter("give the names of nodes, or --all")
    outcomes = aio.run(_kill(nodes, timeout, master, by_signal=signal))
    if outcomes is None:
        return  # Ctrl-C
    if json:
        say(json_line([outcome.json() for outcome in outcomes]))
    for outcome in outcomes:
        if outcome.error:
            print(f"error: {outcome.error}", file=sys.stderr)
        elif not json:
            say(outcome.line())
    if any(outcome.error for outcome in outcomes):
        raise typer.Exit(1)


async def _kill(
    names: list[str] | None, timeout_s: float, master: str | None, *, by_signal: bool
) -> list[Outcome]:
    from simple_ros.net.master_client import MasterClient

    async with MasterClient(master) as client:
        nodes = await _wanted(client, names)
        outcomes: dict[str, Outcome] = {}
        # A C++ Master tells no instance ids: there, a node without one may well be ours.
        unclear = any(not node.instance_id for node in nodes) and await _is_foreign(client)
        asked = [node for node in nodes if node.instance_id or unclear]
        if asked:
            outcomes |= await _ask(client, asked, timeout_s)
        deaf = [
            node
            for node in nodes
            if not node.instance_id
            and (node.node_name not in outcomes or outcomes[node.node_name].error)
        ]
        if by_signal or not unclear:
            found = await end_processes(deaf, timeout_s, master, by_signal=by_signal)
            outcomes |= {outcome.name: outcome for outcome in found}
    return [outcomes[node.node_name] for node in nodes]


async def _wanted(client: MasterClient, names: list[str] | None) -> list[ros.NodeInfo]:
    """The nodes of these names, or all; each once, by name.

    Raises:
        UnknownName: The Master knows one of them not.
    """
    if names is None or not names:
        found = await client.get_nodes()
    else:
        found = [(await find_node(client, name)).node_info for name in names]
    return [node for _, node in sorted({node.node_name: node for node in found}.items())]


async def _is_foreign(client: MasterClient) -> bool:
    """Whether the Master is C++ simple_ros's."""
    from simple_ros.net.master_client import ForeignMaster
    from simple_ros.rpc import master_pb2, methods

    try:
        await client.call(methods.GET_TYPE, master_pb2.GetTypeRequest())
    except ForeignMaster:
        return True
    return False


async def _ask(
    client: MasterClient, nodes: list[ros.NodeInfo], timeout_s: float
) -> dict[str, Outcome]:
    """Ask nodes, all at once, and wait for the Master to strike them off."""
    loop = asyncio.get_running_loop()
    end = loop.time() + timeout_s
    problems = await asyncio.gather(*(ask_to_end(node, timeout_s) for node in nodes))
    reached = [node for node, problem in zip(nodes, problems, strict=True) if not problem]
    left = await wait_until_unlisted(client, reached, end)
    outcomes = {}
    for node, problem in zip(nodes, problems, strict=True):
        name, error = node.node_name, problem
        if not problem and node in left:
            error = f"{name} did not end within {timeout_s:g} s"
            if not node.instance_id:
                error += " (a C++ node cannot be asked; on its host, --signal ends its process)"
        outcomes[name] = Outcome(name, error)
    return outcomes
