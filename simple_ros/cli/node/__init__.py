"""``simple-ros node``: the nodes of the graph, one by one."""

from __future__ import annotations

import typer

from simple_ros.cli.node.killing import kill
from simple_ros.cli.node.listing import info, list_nodes
from simple_ros.cli.node.pinging import ping

__all__ = ["app"]

app = typer.Typer(help="Look at the nodes of the graph, and end them.", no_args_is_help=True)
app.command("list")(list_nodes)
app.command("info")(info)
app.command("ping")(ping)
app.command("kill")(kill)
