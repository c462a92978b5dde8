"""The formats of ``simple-ros graph``: from a snapshot to text."""

from __future__ import annotations

import sys
from enum import Enum
from typing import TYPE_CHECKING

from simple_ros.errors import SimpleRosError

if TYPE_CHECKING:
    from simple_ros.graph import GraphSnapshot
    from simple_ros.graph_view import View

__all__ = ["CannotDraw", "Format", "page", "shown", "svg", "written"]

_GRAPHVIZ_LIMIT_S = 60.0


class Format(Enum):
    """How a graph is written."""

    READABLE = "readable"
    DOT = "dot"
    JSON = "json"
    MERMAID = "mermaid"
    HTML = "html"
    SVG = "svg"


class CannotDraw(SimpleRosError, RuntimeError):
    """Graphviz is missing or did not do it; the message says what to do instead."""


def written(graph: GraphSnapshot, format: Format, *, topics: bool = False) -> str:  # noqa: A002
    """A format that is text: all but html and svg, which have functions of their own."""
    from simple_ros.graph import to_dot, to_json, to_readable_string
    from simple_ros.graph_drawings import to_topic_dot

    match format:
        case Format.JSON:
            return to_json(graph)
        case Format.MERMAID:
            return _mermaid(_view(graph, topics=topics))
        case Format.DOT if topics:
            return to_topic_dot(_view(graph, topics=True))
        case Format.DOT:
            return to_dot(graph)
        case _:
            return to_readable_string(graph)


def _view(graph: GraphSnapshot, *, topics: bool) -> View:
    from simple_ros.graph_view import node_view, topic_view

    return topic_view(graph) if topics else node_view(graph)


def _mermaid(view: View) -> str:
    from simple_ros.graph_drawings import MERMAID_MAX_ARROWS, to_mermaid

    if len(view.arrows) > MERMAID_MAX_ARROWS:
        print(
            f"warning: {len(view.arrows)} arrows; Mermaid refuses more than {MERMAID_MAX_ARROWS} "
            "unless its maxEdges says otherwise; use --filter, or -o graph.html",
            file=sys.stderr,
        )
    return to_mermaid(view)


def page(graph: GraphSnapshot, *, topics: bool, heading: str) -> str:
    """The format html."""
    from importlib.resources import files

    from simple_ros.graph_page import to_html

    folder = files("simple_ros.cli")
    return to_html(
        graph,
        _view(graph, topics=topics),
        heading,
        style=folder.joinpath("graph_page.css").read_text(encoding="utf-8"),
        script=folder.joinpath("graph_page.js").read_text(encoding="utf-8"),
    )


async def svg(dot: str) -> str:
    """The format svg, drawn by Graphviz.

    Raises:
        CannotDraw: It is not installed, takes more than a minute, or failed.
    """
    import asyncio
    import shutil

    program = shutil.which("dot")
    instead = "other formats need no program: html, mermaid, dot, json, readable"
    if program is None:
        raise CannotDraw(
            f"svg is drawn by Graphviz, which is not installed: 'apt install graphviz'; {instead}"
        )
    pipe = asyncio.subprocess.PIPE
    process = await asyncio.create_subprocess_exec(
        program, "-Tsvg", stdin=pipe, stdout=pipe, stderr=pipe
    )
    try:
        async with asyncio.timeout(_GRAPHVIZ_LIMIT_S):
            picture, complaints = await process.communicate(dot.encode())
    except TimeoutError:
        raise CannotDraw(
            f"Graphviz did not finish within {_GRAPHVIZ_LIMIT_S:g} s: the graph is large; use "
            f"--filter, or a format of ours ({instead})"
        ) from None
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    if process.returncode:
        reason = " ".join(complaints.decode(errors="replace").split()) or "it said nothing"
        raise CannotDraw(f"Graphviz failed (code {process.returncode}): {reason}; {instead}")
    return picture.decode()


def shown(text: str, format: Format) -> str:  # noqa: A002
    """What a terminal may get: names of others shall not move its cursor."""
    from simple_ros.graph_view import printable

    if format is not Format.READABLE or not sys.stdout.isatty():
        return text
    return "\n".join(map(printable, text.split("\n")))
