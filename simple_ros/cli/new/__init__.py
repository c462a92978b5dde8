"""``simple-ros new``: a small file to begin with."""

from __future__ import annotations

import typer

from simple_ros.cli.new.kinds import launch, listener, message, package, service, talker

__all__ = ["app"]

app = typer.Typer(help="Begin a node, a message type or a package.", no_args_is_help=True)
app.command("talker")(talker)
app.command("listener")(listener)
app.command("msg")(message)
app.command("service")(service)
app.command("launch")(launch)
app.command("package")(package)
