"""The command ``simple-ros demo turtlesim``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from simple_ros.errors import SimpleRosError

__all__ = ["turtlesim"]

_LAYOUT = Path(__file__).parent / "layout.json"
_PORT = {"min": 0, "max": 65535}


def turtlesim(
    duration: Annotated[
        float,
        typer.Option(min=0, metavar="SECONDS", help="End so long after the start; 0 for never."),
    ] = 0.0,
    rounds: Annotated[
        int,
        typer.Option(
            min=0, help="End when the network ran short and recovered so often; 0: never."
        ),
    ] = 0,
    pace: Annotated[
        float,
        typer.Option(
            min=1, max=600, metavar="SECONDS", help="An act of the story lasts so long at least."
        ),
    ] = 15.0,
    setup: Annotated[
        float,
        typer.Option(
            min=0,
            max=60,
            metavar="SECONDS",
            help="A bearer of the simulated network takes so long.",
        ),
    ] = 2.0,
    plain: Annotated[bool, typer.Option("--plain", help="No colours.")] = False,
    port: Annotated[
        int, typer.Option(**_PORT, help="Of the demo's Master; the next free one, 0 for any.")
    ] = 50051,
    turtles_port: Annotated[
        int, typer.Option(**_PORT, help="Of the page of the turtles; likewise.")
    ] = 8091,
    scores_port: Annotated[
        int, typer.Option(**_PORT, help="Of the page of scores; likewise.")
    ] = 8090,
    foxglove_port: Annotated[
        int, typer.Option(**_PORT, help="Of the Foxglove bridge; likewise.")
    ] = 8765,
    no_foxglove: Annotated[
        bool, typer.Option("--no-foxglove", help="Start no Foxglove bridge.")
    ] = False,
    record: Annotated[
        Path | None,
        typer.Option(dir_okay=False, help="Record all topics but the relayed ones (MCAP)."),
    ] = None,
    layout: Annotated[
        bool, typer.Option("--layout", help="Print a layout for Foxglove (JSON) and end.")
    ] = False,
) -> None:
    """Drive two turtles over a simulated mobile network that runs short, gets worse and recovers.

    Starts a Master, the mock network, turtles, controllers, relay, watcher, scores, maximizer and a Foxglove bridge, and
    tells what happens. No radio is behind any number. Ctrl-C ends everything.
    """
    if layout:
        typer.echo(_LAYOUT.read_text(encoding="utf-8").rstrip())
        return
    from simple_ros import aio
    from simple_ros_engines.network_exposure.demo.performance import Performance, Wishes

    wishes = Wishes(
        duration_s=duration,
        rounds=rounds,
        pace_s=pace,
        setup_s=setup,
        is_plain=plain,
        master_port=port,
        turtles_port=turtles_port,
        scores_port=scores_port,
        foxglove_port=None if no_foxglove else foxglove_port,
        record=record,
    )

    async def play() -> None:
        await Performance(wishes).run()

    try:
        aio.run(play())
    except (SimpleRosError, OSError) as error:
        typer.echo(f"error: {error}", err=True)
        raise typer.Exit(1) from None
