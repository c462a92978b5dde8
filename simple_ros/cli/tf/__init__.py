"""``simple-ros tf``: the tree of frames, one transform, and how transforms arrive."""

from __future__ import annotations

import typer

from simple_ros.cli.tf.echo import echo
from simple_ros.cli.tf.monitor import monitor
from simple_ros.cli.tf.tree import tree

__all__ = ["app"]

app = typer.Typer(help="Look at coordinate frames.", no_args_is_help=True)
app.command("tree")(tree)
app.command("echo")(echo)
app.command("monitor")(monitor)
