"""The command ``simple-ros pico launch``: the launch files of this package by their names."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

__all__ = ["LAUNCH_FILES", "launch"]

LAUNCH_FILES = {
    path.stem: path for path in sorted((Path(__file__).parent / "launch").glob("*.yaml"))
}
"""By name, without ``.yaml``."""


def launch(
    name: Annotated[str, typer.Argument(metavar="NAME", help=f"One of {', '.join(LAUNCH_FILES)}.")],
    words: Annotated[
        list[str] | None,
        typer.Argument(metavar="[ARG:=VALUE]...", help="Arguments of the launch file."),
    ] = None,
    show: Annotated[
        bool, typer.Option("--show", "--dry-run", help="What would be started, and end.")
    ] = False,
    args: Annotated[
        bool, typer.Option("--args", help="The arguments of the file, and end.")
    ] = False,
    path: Annotated[
        bool, typer.Option("--path", help="Where the file is, to be included or copied, and end.")
    ] = False,
    plain: Annotated[bool, typer.Option("--plain", help="One line an event, no table.")] = False,
) -> None:
    """Launch the robot, or a part of it, as 'simple-ros launch' does with a file."""
    from simple_ros.cli import launch as library

    file = LAUNCH_FILES.get(name.removesuffix(".yaml"))
    if file is None:
        raise typer.BadParameter(f"there is no {name!r}, only {', '.join(LAUNCH_FILES)}")
    if path:
        typer.echo(file)
        return
    library.command(file, words, show=show, args=args, plain=plain)
