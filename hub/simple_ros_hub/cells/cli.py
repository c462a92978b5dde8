"""``simple-ros cell``: the cells of installed packages."""

from __future__ import annotations

import json
import sys
from typing import Annotated

import typer

__all__ = ["GROUP", "app"]

GROUP = "simple_ros.cells"

app = typer.Typer(
    help="List and run cells of installed packages.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


@app.command("list")
def list_cells(
    as_json: Annotated[bool, typer.Option("--json", help="For programs.")] = False,
) -> None:
    """List the cells that installed packages offer."""
    from simple_ros import plugins

    found = []
    for name, cell in plugins.load_all(GROUP):
        if isinstance(cell, plugins.BrokenPlugin):
            print(f"warning: {cell}", file=sys.stderr)
        else:
            found.append({"name": name, "summary": cell.summary, "priority": cell.priority})
    if as_json:
        print(json.dumps(found))
        return
    width = max((len(item["name"]) for item in found), default=0)
    for item in found:
        print(f"{item['name']:<{width}}  {item['summary']}")


@app.command("run")
def run_cell(
    name: Annotated[str, typer.Argument(help="Which.")],
    master: Annotated[
        str | None, typer.Option(metavar="HOST:PORT", help="Where the Master is.")
    ] = None,
) -> None:
    """Run a cell as a node, until Ctrl-C."""
    from simple_ros import aio, plugins

    cell = plugins.load(GROUP, name)()

    async def work() -> None:
        async with aio.NodeHandle(cell.node_name, master=master) as node:
            await cell.run(node)

    aio.run(work())
