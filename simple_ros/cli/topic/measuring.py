"""``simple-ros topic hz`` and ``bw``."""

from __future__ import annotations

import asyncio
import sys
import time
from collections.abc import Callable
from typing import Annotated

import typer

from simple_ros.cli.completion import complete_topics
from simple_ros.cli.options import JsonOption, MasterOption, Style, StyleOption, WindowOption
from simple_ros.cli.topic.displays import Display, cpp_rates, json_lines, lines, live_table
from simple_ros.cli.topic.following import cli_node, subscribe_bytes, type_of, while_running
from simple_ros.cli.topic.quantities import BANDWIDTH, RATE, Quantity, Window
from simple_ros.errors import InvalidName, SimpleRosError

__all__ = ["bw", "hz"]

_REPORT_S = 1.0

TopicsArgument = Annotated[
    list[str] | None,
    typer.Argument(metavar="TOPIC", help="Names of topics.", autocompletion=complete_topics),
]
AllOption = Annotated[bool, typer.Option("--all", help="Every topic that is listed now.")]


def hz(
    topics: TopicsArgument = None,
    every: AllOption = False,
    window: WindowOption = 100,
    json: JsonOption = False,
    style: StyleOption = Style.READABLE,
    master: MasterOption = None,
) -> None:
    """Print once a second how often messages arrive, until Ctrl-C.

    Several topics are a table in a terminal, and lines elsewhere.
    """
    if style is Style.CPP and (json or every or len(topics or ()) > 1):
        raise typer.BadParameter("--format cpp goes with one topic, and without --json")
    cpp = style is Style.CPP
    _run(
        "hz",
        topics,
        every,
        window,
        master,
        lambda several: cpp_rates() if cpp else _display(RATE, json, several),
    )


def bw(
    topics: TopicsArgument = None,
    every: AllOption = False,
    window: WindowOption = 100,
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Print once a second how many bytes of messages arrive, until Ctrl-C.

    Several topics are a table in a terminal, and lines elsewhere.
    """
    _run("bw", topics, every, window, master, lambda several: _display(BANDWIDTH, json, several))


def _display(quantity: Quantity, json: bool, several: bool) -> Display:
    if json:
        return json_lines(quantity)
    return live_table(quantity) if several and sys.stdout.isatty() else lines(quantity)


def _run(
    verb: str,
    topics: list[str] | None,
    every: bool,
    length: int,
    master: str | None,
    display: Callable[[bool], Display],
) -> None:
    from simple_ros import aio

    if every == bool(topics):
        raise typer.BadParameter("give the names of topics, or --all")
    aio.run(_measure(verb, topics, length, master, display))


async def _measure(
    verb: str,
    topics: list[str] | None,
    length: int,
    master: str | None,
    display: Callable[[bool], Display],
) -> None:
    """Subscribe and report once a second, also that nothing came.

    Raises:
        UnknownName: The Master knows no such topic.
    """
    types = await (_listed(master) if topics is None else _named(topics, master))
    windows = [Window(name, length) for name in types]

    async def report() -> None:
        with display(len(windows) > 1) as show:
            while True:
                await asyncio.sleep(_REPORT_S)
                show(windows)

    async with cli_node(verb, master) as node:
        for window in windows:
            await subscribe_bytes(node, window.topic, types[window.topic], _taker(window))
        await while_running(node, report())


def _taker(window: Window) -> Callable[[bytes], None]:
    return lambda payload: window.take(time.perf_counter(), len(payload))


async def _named(topics: list[str], master: str | None) -> dict[str, str]:
    return dict([await type_of(topic, master) for topic in topics])


async def _listed(master: str | None) -> dict[str, str]:
    """All topics and their types; a name that the rules forbid is told and left out."""
    from simple_ros.names import topic_name
    from simple_ros.net.master_client import MasterClient

    async with MasterClient(master) as client:
        found = await client.get_topics()
    types = {}
    for topic in sorted(found, key=lambda topic: topic.topic_name):
        try:
            types[topic_name(topic.topic_name)] = topic.msg_type
        except InvalidName as error:
            print(f"warning: a topic is left out: {' '.join(str(error).split())}", file=sys.stderr)
    if not types:
        raise SimpleRosError("the Master lists no topics")
    return types
