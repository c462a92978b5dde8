"""``simple-ros demo``: a flying quadrotor, to see that everything works, and the demos of plug-ins."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path
from typing import Annotated

import typer

from simple_ros.cli.plugins import Demos
from simple_ros.cli.text import say

__all__ = ["app"]

app = typer.Typer(
    cls=Demos,
    help="Fly a simulated quadrotor, or run another demo by name.",
    invoke_without_command=True,
    no_args_is_help=False,
    pretty_exceptions_enable=False,
)


@app.callback()
def _quadrotor(
    ctx: typer.Context,
    master_port: Annotated[
        int,
        typer.Option(
            min=0, max=65535, help="Port of the demo's Master; another is chosen if it is taken."
        ),
    ] = 50051,
    duration: Annotated[
        float | None,
        typer.Option(
            min=0.1, metavar="SECONDS", help="End after flying so long.", show_default="never"
        ),
    ] = None,
    plain: Annotated[bool, typer.Option("--plain", help="One line a second, no screen.")] = False,
    foxglove_port: Annotated[
        int,
        typer.Option(
            min=0, max=65535, help="Port of the Foxglove bridge; the next free one if it is taken."
        ),
    ] = 8765,
    no_foxglove: Annotated[
        bool, typer.Option("--no-foxglove", help="Start no Foxglove bridge.")
    ] = False,
    layout: Annotated[
        bool, typer.Option("--layout", help="Print a layout for Foxglove (JSON) and end.")
    ] = False,
) -> None:
    """Fly a simulated quadrotor: a Master, two nodes and a view of them. Or run another demo by name.

    It can be seen in Foxglove and Lichtblick, too: open the link, import what --layout prints.

    Ctrl-C ends everything, with code 0. Code 1: a process ended by itself or messages do not flow.
    """
    if ctx.invoked_subcommand is not None:
        return
    if layout:
        from simple_ros.foxglove.layouts import layout_text

        say(layout_text("quadrotor"))
        return
    from simple_ros import aio
    from simple_ros.demos.displays import suitable_display
    from simple_ros.demos.quad_demo import QuadDemo

    async def fly() -> None:
        display = suitable_display(plain=plain)
        bridge_port = None if no_foxglove else foxglove_port
        demo = QuadDemo(display, _own_name(), duration, bridge_port)
        try:
            with display:
                await demo.run(master_port)
        finally:
            print(demo.summary)

    aio.run(fly())


def _own_name() -> str:
    """How the user calls this program: by name if it is found, else by path."""
    program = Path(sys.argv[0])
    if shutil.which("simple-ros") or program.name != "simple-ros":
        return "simple-ros"
    return os.path.relpath(program)
