"""``simple-ros service``: which services there are, who provides them, and calls by hand."""

from __future__ import annotations

import typer

from simple_ros.cli.service.calling import call
from simple_ros.cli.service.listing import find, info, list_services, print_type

__all__ = ["app"]

app = typer.Typer(help="Look at services, and call them.", no_args_is_help=True)
app.command("list")(list_services)
app.command("info")(info)
app.command("type")(print_type)
app.command("find")(find)
app.command("call")(call)
