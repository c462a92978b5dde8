"""``simple-ros log``: what the nodes log."""

from __future__ import annotations

import re
import sys
from datetime import datetime
from typing import TYPE_CHECKING, Annotated

import typer

from simple_ros.cli.completion import complete_nodes
from simple_ros.cli.lookup import ask
from simple_ros.cli.options import CountOption, JsonOption, MasterOption, NodeArgument
from simple_ros.cli.text import json_line, say
from simple_ros.cli.topic.following import cli_node, while_running
from simple_ros.errors import ConfigError, SimpleRosError

if TYPE_CHECKING:
    from collections.abc import Callable

    from simple_ros.msg.rosgraph_msgs import Log
    from simple_ros.net.master_client import MasterClient
    from simple_ros.node import NodeHandle

__all__ = ["app", "line_json", "line_text", "line_wanted", "printable"]

app = typer.Typer(help="Follow what the nodes log, and change from which level on they do.")

LOG_LEVEL = "log_level"

_COLOURS = {"debug": "2", "warn": "33", "error": "31", "fatal": "1;31"}


@app.callback(invoke_without_command=True)
def follow(
    context: typer.Context,
    level: Annotated[
        str, typer.Option(metavar="LEVEL", help="From debug, info, warn, error or fatal on.")
    ] = "debug",
    node: Annotated[
        list[str] | None,
        typer.Option(metavar="NODE", help="Only of these.", autocompletion=complete_nodes),
    ] = None,
    grep: Annotated[
        str | None, typer.Option(metavar="REGEX", help="Only lines in which this is found.")
    ] = None,
    count: CountOption = None,
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="With file, line and function.")
    ] = False,
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Follow what the nodes log on rosout, until Ctrl-C; or change a node's level."""
    from simple_ros import aio

    if context.invoked_subcommand is not None:
        return
    wanted = line_wanted(level, node or [], _pattern(grep))
    colour = sys.stdout.isatty()

    def write(message: Log) -> str:
        return line_json(message) if json else line_text(message, colour=colour, verbose=verbose)

    aio.run(_follow(wanted, write, count, master))


def _pattern(grep: str | None) -> re.Pattern[str] | None:
    try:
        return None if grep is None else re.compile(grep)
    except re.error as error:
        raise typer.BadParameter(f"--grep {grep!r} is no regular expression: {error}") from None


def line_wanted(
    level: str, nodes: list[str], pattern: re.Pattern[str] | None
) -> Callable[[Log], bool]:
    """What says whether a line is to be shown.

    Raises:
        BadParameter: There is no such level.
    """
    from simple_ros.log_levels import python_level, ros_level
    from simple_ros.names import canonical

    try:
        least = ros_level(python_level(level))
    except ConfigError as error:
        raise typer.BadParameter(str(error)) from None
    names = {canonical(name) for name in nodes}

    def wanted(line: Log) -> bool:
        return (
            line.level >= least
            and (not names or canonical(line.name) in names)
            and (pattern is None or pattern.search(line.msg) is not None)
        )

    return wanted


def line_text(line: Log, *, colour: bool, verbose: bool) -> str:
    """A line for people: local time, level, node, text."""
    from simple_ros.log_levels import level_name

    name = level_name(line.level)
    moment = datetime.fromtimestamp(line.header.stamp.seconds).strftime("%H:%M:%S")
    moment += f".{line.header.stamp.nanos // 1_000_000:03d}"
    text = f"{moment} {name:<5} {printable(line.name)}: {printable(line.msg)}"
    if verbose:
        text += f"  ({printable(line.file)}:{line.line} {printable(line.function)})"
    code = _COLOURS.get(name) if colour else None
    return text if code is None else f"\x1b[{code}m{text}\x1b[0m"


def printable(text: str) -> str:
    """Text whose control characters do nothing to the terminal; line breaks and tabs stay."""
    return "".join(
        char if char.isprintable() or char in "\n\t" else char.encode("unicode_escape").decode()
        for char in text
    )


def line_json(line: Log) -> str:
    """A line for programs."""
    from simple_ros.log_levels import level_name

    return json_line(
        {
            "stamp_ns": line.header.stamp.ToNanoseconds(),
            "level": level_name(line.level),
            "node": line.name,
            "text": line.msg,
            "file": line.file,
            "line": line.line,
            "function": line.function,
        }
    )


async def _follow(
    wanted: Callable[[Log], bool],
    write: Callable[[Log], str],
    count: int | None,
    master: str | None,
) -> None:
    async with cli_node("log", master) as node:
        await while_running(node, _print(node, wanted, write, count))


async def _print(
    node: NodeHandle,
    wanted: Callable[[Log], bool],
    write: Callable[[Log], str],
    count: int | None,
) -> None:
    from simple_ros.msg.rosgraph_msgs import Log
    from simple_ros.qos import QosProfile, Reliability

    qos = QosProfile(depth=10_000, reliability=Reliability.BEST_EFFORT)
    left = count
    async for line in await node.subscribe("/rosout", Log, qos=qos):
        if wanted(line):
            say(write(line))
            if left is not None and (left := left - 1) == 0:
                return


class NoLogLevel(SimpleRosError, LookupError):
    """A node has no parameter to set its log level by.

    Attributes:
        node: Its name.
    """

    def __init__(self, node: str) -> None:
        self.node = node
        super().__init__(
            f"no node {node!r} has the parameter {LOG_LEVEL!r}: it does not run, or has not enabled "
            "rosout (docs/logging.md)"
        )


@app.command("set-level")
def set_level(
    node: NodeArgument,
    level: Annotated[
        str, typer.Argument(metavar="LEVEL", help="debug, info, warn, error or fatal.")
    ],
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Change from which level on a node logs: sets its parameter log_level."""
    from simple_ros.log_levels import LEVEL_NAMES, python_level
    from simple_ros.names import canonical

    try:
        wanted = LEVEL_NAMES[(python_level(level) - 10) // 10]
    except ConfigError as error:
        raise typer.BadParameter(str(error)) from None
    name = canonical(node)
    ask(master, lambda client: _set_level(client, name, wanted))
    say(json_line({"node": name, "level": wanted}) if json else f"{name} logs from {wanted} on")


async def _set_level(client: MasterClient, node: str, level: str) -> None:
    from simple_ros.parameters.calls import ParameterCalls

    calls = ParameterCalls(client)
    name = f"{node}/{LOG_LEVEL}"
    if name not in await calls.list(node):
        raise NoLogLevel(node)
    infos = await calls.describe(name)
    if not any(info.name == name and info.nodes for info in infos):
        raise NoLogLevel(node)
    await calls.set({name: level})
