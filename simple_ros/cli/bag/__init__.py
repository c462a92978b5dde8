"""``simple-ros bag``: record topics into files, play them back, look after the files."""

from __future__ import annotations

import typer

from simple_ros.cli.bag.care import doctor, recover
from simple_ros.cli.bag.looking import get, info, list_topics
from simple_ros.cli.bag.playing import play
from simple_ros.cli.bag.recording import record
from simple_ros.cli.bag.rewriting import convert, filter_messages, merge

__all__ = ["app"]

app = typer.Typer(help="Record topics into MCAP files, and play them back.", no_args_is_help=True)
app.command("record")(record)
app.command("play")(play)
app.command("info")(info)
app.command("list")(list_topics)
app.command("get")(get)
app.command("filter")(filter_messages)
app.command("convert")(convert)
app.command("merge")(merge)
app.command("recover")(recover)
app.command("doctor")(doctor)
