"""``simple-ros graph``: who is there and what flows between them."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from simple_ros.cli.graph_formats import Format, page, shown, svg, written
from simple_ros.cli.graph_watch import watch as watch_graph
from simple_ros.cli.options import MasterOption
from simple_ros.cli.text import say
from simple_ros.errors import SimpleRosError

if TYPE_CHECKING:
    from simple_ros.net.master_client import MasterClient

__all__ = ["command"]


_DRAWN = (Format.DOT, Format.MERMAID, Format.HTML, Format.SVG)
_BY_SUFFIX = {
    ".txt": Format.READABLE,
    ".dot": Format.DOT,
    ".gv": Format.DOT,
    ".json": Format.JSON,
    ".mmd": Format.MERMAID,
    ".mermaid": Format.MERMAID,
    ".html": Format.HTML,
    ".htm": Format.HTML,
    ".svg": Format.SVG,
}


class CannotWrite(SimpleRosError, OSError):
    """A file cannot be written; the message says why."""


def command(
    format: Annotated[  # noqa: A002
        Format | None,
        typer.Option(
            help="readable is for people, json for programs, the others are drawings.",
            show_default="by the name of the output file, else readable",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help="Write into this file."),
    ] = None,
    topics: Annotated[
        bool,
        typer.Option("--topics", help="Draw topics between the nodes (dot, mermaid, html, svg)."),
    ] = False,
    filter: Annotated[  # noqa: A002
        str, typer.Option(metavar="TEXT", help="Only what is linked with names that contain this.")
    ] = "",
    watch: Annotated[
        bool, typer.Option("--watch", help="Go on with a line for every change, until Ctrl-C.")
    ] = False,
    master: MasterOption = None,
) -> None:
    """Print or draw who is there and what flows from whom to whom.

    `-o graph.html` is a page to look around in, `-o graph.svg` a picture (needs Graphviz).
    """
    from simple_ros import aio

    chosen = _chosen(format, output)
    if topics and chosen not in _DRAWN:
        names = ", ".join(drawn.value for drawn in _DRAWN)
        raise typer.BadParameter(f"--topics is for {names}, not for {chosen.value}")
    if watch and (output is not None or chosen not in (Format.READABLE, Format.JSON)):
        raise typer.BadParameter("--watch writes readable or json, to the terminal")
    if watch:
        aio.run(watch_graph(master, chosen, filter))
    elif (text := aio.run(_text(master, chosen, filter, topics=topics))) is None:
        raise typer.Exit(130)  # Ctrl-C while a Master or Graphviz took its time
    elif output is None:
        say(shown(text, chosen))
    else:
        _write(output, text)


def _chosen(format: Format | None, output: Path | None) -> Format:  # noqa: A002
    if format is not None or output is None:
        return format or Format.READABLE
    guessed = _BY_SUFFIX.get(output.suffix.lower())
    if guessed is None:
        known = " ".join(_BY_SUFFIX)
        raise typer.BadParameter(
            f"no format is known by the name {output.name!r}: name it with "
            f"--format, or end the name with one of {known}"
        )
    return guessed


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text.removesuffix("\n") + "\n", encoding="utf-8")
    except OSError as error:
        raise CannotWrite(f"cannot write {str(path)!r}: {error.strerror or error}") from None


# -- once ------------------------------------------------------------------------------------------


async def _text(
    master: str | None,
    format: Format,  # noqa: A002
    filter: str,  # noqa: A002
    *,
    topics: bool,
) -> str:
    from simple_ros.graph_source import fetch_graph
    from simple_ros.graph_view import filtered
    from simple_ros.net.master_client import ForeignMaster, MasterClient

    async with MasterClient(master) as client:
        if not (filter or topics) and format in (Format.READABLE, Format.DOT, Format.JSON):
            with suppress(ForeignMaster):
                return await _exported(client, format)
        graph = await fetch_graph(client)
        address = client.address
    graph = filtered(graph, filter) if filter else graph
    if format is Format.HTML:
        return page(graph, topics=topics, heading=_heading(address, filter))
    if format is Format.SVG:
        return await svg(written(graph, Format.DOT, topics=topics))
    return written(graph, format, topics=topics)


async def _exported(client: MasterClient, format: Format) -> str:  # noqa: A002
    from simple_ros.rpc import master_pb2

    numbers = {
        Format.READABLE: master_pb2.GRAPH_FORMAT_READABLE,
        Format.DOT: master_pb2.GRAPH_FORMAT_DOT,
        Format.JSON: master_pb2.GRAPH_FORMAT_JSON,
    }
    return await client.export_graph(numbers[format])


def _heading(address: str, filter: str) -> str:  # noqa: A002
    what = f" around {filter!r}" if filter else ""
    return f"simple_ros graph{what}, Master at {address}"
