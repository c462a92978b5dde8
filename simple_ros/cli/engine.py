"""``simple-ros engine``: the engines of installed packages."""

from __future__ import annotations

import json
import sys
from typing import Annotated

import typer

__all__ = ["app"]

app = typer.Typer(
    help="List and run engines of installed packages.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


@app.command("list")
def list_engines(
    as_json: Annotated[bool, typer.Option("--json", help="For programs.")] = False,
) -> None:
    """List the engines that installed packages offer."""
    from simple_ros import plugins
    from simple_ros.engine import engine_named

    found = []
    for name in plugins.names(plugins.ENGINES):
        try:
            found.append({"name": name, "summary": engine_named(name).summary})
        except plugins.BrokenPlugin as error:
            print(f"warning: {error}", file=sys.stderr)
    if as_json:
        print(json.dumps(found))
        return
    width = max((len(item["name"]) for item in found), default=0)
    for item in found:
        print(f"{item['name']:<{width}}  {item['summary']}")


@app.command("run")
def run_engine(
    name: Annotated[str, typer.Argument(help="Which.")],
    node_name: Annotated[
        str | None, typer.Option("--node-name", help="Instead of the engine's own.")
    ] = None,
    master: Annotated[
        str | None, typer.Option(metavar="HOST:PORT", help="Where the Master is.")
    ] = None,
) -> None:
    """Run an engine as a node, until Ctrl-C."""
    from simple_ros import aio
    from simple_ros.engine import engine_named

    engine = engine_named(name)

    async def work() -> None:
        async with aio.NodeHandle(node_name or engine.node_name, master=master) as node:
            await engine.run(node)

    aio.run(work())
