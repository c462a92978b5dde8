"""``simple-ros topic``: what flows, how fast, and a way to publish by hand."""

from __future__ import annotations

import typer

from simple_ros.cli.topic.delaying import delay
from simple_ros.cli.topic.echoing import echo
from simple_ros.cli.topic.listing import find, info, list_topics
from simple_ros.cli.topic.measuring import bw, hz
from simple_ros.cli.topic.publishing import pub

__all__ = ["app"]

app = typer.Typer(help="Look at topics, and publish on them.", no_args_is_help=True)
app.command("list")(list_topics)
app.command("info")(info)
app.command("find")(find)
app.command("echo")(echo)
app.command("hz")(hz)
app.command("bw")(bw)
app.command("delay")(delay)
app.command("pub")(pub)
