"""``simple-ros action``: what actions there are, and a way to send them goals by hand."""

from __future__ import annotations

import typer

from simple_ros.cli.action.goals import cancel, result, send_goal
from simple_ros.cli.action.looking import info, list_actions

__all__ = ["app"]

app = typer.Typer(help="Look at actions, and send them goals.", no_args_is_help=True)
app.command("list")(list_actions)
app.command("info")(info)
app.command("send-goal")(send_goal)
app.command("result")(result)
app.command("cancel")(cancel)
