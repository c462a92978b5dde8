"""The command ``simple-ros-pico-bridge``, which is also ``simple-ros pico bridge``."""

from __future__ import annotations

import dataclasses
import logging
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from simple_ros import aio
from simple_ros.errors import ConfigError, SimpleRosError
from simple_ros.ready import ready
from simple_ros_firmware_bridge.bridge import PicoBridge
from simple_ros_firmware_bridge.config import (
    DEFAULT_BAUD,
    BoardConfig,
    check_ports,
    load_boards,
)
from simple_ros_firmware_bridge.control.cli import controller
from simple_ros_firmware_bridge.launching import launch
from simple_ros_firmware_bridge.memory_file import default_directory
from simple_ros_firmware_bridge.node_words import Words, take_words
from simple_ros_firmware_bridge.simulator.cli import simulator

__all__ = ["PROGRAM", "app", "bridge"]

PROGRAM = "simple-ros-pico-bridge"

app = typer.Typer(no_args_is_help=True, help="Boards with micro-ROS firmware.")


app.command()(simulator)
app.command()(controller)
app.command()(launch)


@app.command()
def bridge(
    words: Words = None,
    port: Annotated[
        list[str] | None,
        typer.Option(metavar="PATH[=PREFIX]", help="Serial port, and a namespace for its topics."),
    ] = None,
    baud: Annotated[int, typer.Option(min=1, help="Of a UART; USB ignores it.")] = DEFAULT_BAUD,
    remap: Annotated[
        list[str] | None,
        typer.Option(metavar="BOARD:=GRAPH", help="Another name for a topic of the board."),
    ] = None,
    config: Annotated[
        Path | None,
        typer.Option(metavar="FILE", dir_okay=False, help="Boards from a YAML file instead."),
    ] = None,
    udp: Annotated[
        int | None,
        typer.Option(
            metavar="PORT", min=0, max=65535, help="Boards may come over UDP to this port, too."
        ),
    ] = None,
    tcp: Annotated[
        int | None,
        typer.Option(
            metavar="PORT", min=0, max=65535, help="Boards may come over TCP to this port, too."
        ),
    ] = None,
    state: Annotated[
        Path | None,
        typer.Option(metavar="DIR", file_okay=False, help="Where sessions are kept over restarts."),
    ] = None,
    keep: Annotated[bool, typer.Option(help="Keep sessions over restarts.")] = True,
    restamp: Annotated[bool, typer.Option(help="Replace stamps that are no time of day.")] = True,
    master: Annotated[
        str | None, typer.Option(metavar="HOST:PORT", help="Where the Master is.")
    ] = None,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Log more.")] = False,
) -> None:
    """Carry topics between boards with micro-ROS firmware and the graph.

    Without --port it takes the first Pico that is found. Boards and ports may come and go. What is wrong with a board
    is told in words, here and on the topic diagnostics.
    """
    logging.basicConfig(
        stream=sys.stderr,
        level=logging.DEBUG if verbose else logging.INFO,
        format="%(asctime)s %(levelname)s %(message)s",
    )
    logging.getLogger("asyncio").setLevel(logging.INFO)
    take_words(words)
    if config is not None and port:
        raise typer.BadParameter("--config names the boards: give --port or --config")
    try:
        common = BoardConfig(baud=baud, remap=_remaps(remap or ()), restamp=restamp)
        if config is not None:
            boards = load_boards(config)
        else:
            # Who asks for a network port alone has no board on a serial one.
            is_serial = udp is None and tcp is None
            boards = [_board(common, text) for text in port or ([""] if is_serial else [])]
            check_ports(boards)
        directory = (state or default_directory()) if keep else None
        aio.run(_serve(boards, directory, (udp, tcp), common, master))
    except (SimpleRosError, OSError) as error:
        typer.echo(f"error: {getattr(error, 'strerror', None) or error}", err=True)
        raise typer.Exit(1) from None


def _board(common: BoardConfig, text: str) -> BoardConfig:
    path, _, prefix = text.partition("=")
    return dataclasses.replace(common, port=path, prefix=prefix)


def _remaps(words: Sequence[str]) -> dict[str, str]:
    table = {}
    for word in words:
        old, sign, new = word.partition(":=")
        if not (old and sign and new):
            raise ConfigError(f"--remap {word!r}: write it as board_name:=graph_name")
        table[old] = new
    return table


async def _serve(
    boards: Sequence[BoardConfig],
    directory: Path | None,
    ports: tuple[int | None, int | None],
    common: BoardConfig,
    master: str | None,
) -> None:
    async with (
        aio.NodeHandle("pico_bridge", master=master) as node,
        PicoBridge(node, boards, directory, *ports, common),
    ):
        ready()
        await node.spin()
