"""The command ``simple-ros``."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from simple_ros.arguments import use_environment_only
from simple_ros.cli import (
    action,
    bag,
    bench,
    demo,
    diag,
    doctor,
    engine,
    foxglove,
    graph,
    launch,
    log,
    msg,
    new,
    node,
    param,
    service,
    tf,
    topic,
)
from simple_ros.cli.plugins import Nouns
from simple_ros.errors import SimpleRosError

__all__ = ["app", "main"]

app = typer.Typer(
    name="simple-ros",
    cls=Nouns,
    help="Robot middleware in pure Python.",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
)
app.command("graph")(graph.command)
app.add_typer(log.app, name="log")
app.command("diag")(diag.command)
app.command("launch")(launch.command)
app.command("foxglove")(foxglove.command)
app.command("doctor")(doctor.command)
app.command("bench")(bench.command)
app.add_typer(demo.app, name="demo")
app.add_typer(bag.app, name="bag")
app.add_typer(node.app, name="node")
app.add_typer(topic.app, name="topic")
app.add_typer(service.app, name="service")
app.add_typer(action.app, name="action")
app.add_typer(param.app, name="param")
app.add_typer(tf.app, name="tf")
app.add_typer(msg.app, name="msg")
app.add_typer(new.app, name="new")
app.add_typer(engine.app, name="engine")


def _show_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"simple-ros {version('simple-ros')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option("--version", is_eager=True, callback=_show_version, help="Say it and exit."),
    ] = False,
) -> None:
    pass


def main() -> None:
    """Run ``simple-ros``; errors of this project are one line on stderr and exit code 1."""
    # A word with ':=' may well be part of a message here.
    use_environment_only()
    try:
        app(prog_name="simple-ros")
    except SimpleRosError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(1)


if __name__ == "__main__":
    main()
