"""The command ``simple-ros-master``, which is also ``simple-ros master``."""

from __future__ import annotations

import asyncio
import logging
import signal
import sys
from pathlib import Path
from typing import Annotated

import typer

from simple_ros.errors import SimpleRosError
from simple_ros_master.server import DEFAULT_PORT, Master, master_version

__all__ = ["command"]

PROGRAM = "simple-ros-master"


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"{PROGRAM} {master_version()}")
        raise typer.Exit


def command(
    host: Annotated[
        str, typer.Option(help="Address to listen on; 0.0.0.0 or :: for all.")
    ] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port to listen on; 0 for any free one.")
    ] = DEFAULT_PORT,
    parameters: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            dir_okay=False,
            help="Keep parameters that are set in this YAML file, for the next start.",
        ),
    ] = None,
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="Log every registration.")
    ] = False,
    version: Annotated[  # noqa: ARG001  (the callback answers)
        bool,
        typer.Option("--version", is_eager=True, callback=_show_version, help="Say it and exit."),
    ] = False,
) -> None:
    """Run the Master, which brings publishers and subscribers together."""
    logging.basicConfig(
        stream=sys.stderr,
        level=logging.DEBUG if verbose else logging.INFO,
        format="%(asctime)s %(levelname)s %(message)s",
    )
    logging.getLogger("asyncio").setLevel(logging.INFO)
    try:
        asyncio.run(_serve(host, port, parameters))
    except (SimpleRosError, OSError) as error:
        reason = getattr(error, "strerror", None) or error
        typer.echo(f"{PROGRAM}: error: {reason}", err=True)
        raise typer.Exit(1) from None


async def _serve(host: str, port: int, parameters: Path | None) -> None:
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    async with Master(host=host, port=port, parameters=parameters) as master:
        typer.echo(f"{PROGRAM}: listening on {master.address}")
        await stop.wait()
