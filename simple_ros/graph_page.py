"""The graph as one HTML page that fetches nothing.

The drawing is inline SVG, laid out here, so that it also shows where scripts are off; the script moves
the view, searches and highlights. Everything it knows it reads from the drawing, so that names are
escaped in one way only, HTML's. The page's content security policy allows this one style sheet and
this one script, by their hashes, and no connection to anywhere: should a name ever break out of its
place, it finds nothing to run.
"""

from __future__ import annotations

import base64
import hashlib
import unicodedata
from collections import defaultdict
from collections.abc import Sequence
from html import escape

from simple_ros.graph import GraphSnapshot, TopicKey
from simple_ros.graph_layout import Box, layered
from simple_ros.graph_view import Arrow, Kind, Vertex, View, printable

__all__ = ["to_html"]

_CHAR_WIDTH = 7.3
_DETAIL_CHAR_WIDTH = 6.1
_PADDING = 22.0
_HEIGHT = 38.0
_MARGIN = 30.0
_MAX_NAME = 44
_MAX_LABEL = 34
_ARROW_HEAD = (
    '<defs><marker id="tip" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="8" '
    'markerUnits="userSpaceOnUse" orient="auto"><path d="M0 0L8 4L0 8z"/></marker></defs>'
)


def to_html(graph: GraphSnapshot, view: View, heading: str, *, style: str, script: str) -> str:
    """The page.

    Args:
        graph: What the tables list.
        view: What is drawn.
        heading: Title and first words of the page.
        style: The style sheet; must not contain ``</style``.
        script: The program; must not contain ``</script``.
    """
    policy = (
        f"default-src 'none'; style-src '{_hash(style)}'; script-src '{_hash(script)}'; "
        "base-uri 'none'; form-action 'none'"
    )
    title = _text(heading)
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{title}</title>
<style>{style}</style>
</head>
<body>
<header>
<h1>{title}</h1>
<p>{_summary(graph)}</p>
<a class="skip" href="#tables">Skip the drawing; go to the tables</a>
<form id="find" class="scripted" hidden role="search">
<input id="search" type="search" placeholder="Search ( / ), Enter for the next" \
aria-label="Search nodes, topics, addresses and types" autocomplete="off" spellcheck="false">
<span id="hits" role="status"></span>
<button id="nearer" type="button" aria-label="Zoom in">+</button>
<button id="farther" type="button" aria-label="Zoom out">&minus;</button>
<button id="fit" type="button">Fit</button>
</form>
</header>
<div id="stage">
{_drawing(view)}
<aside id="about" aria-live="polite" hidden></aside>
</div>
<main id="tables">
{_tables(graph)}
</main>
<script>{script}</script>
</body>
</html>
"""


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _text(text: str) -> str:
    return escape(printable(text))


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _summary(graph: GraphSnapshot) -> str:
    topics = {key.topic for node in graph.nodes for key in (*node.publishes, *node.subscribes)}
    counts = (
        _count(len(graph.nodes), "node"),
        _count(len(topics), "topic"),
        _count(len(graph.edges), "connection"),
    )
    return ", ".join(counts)


# -- drawing ---------------------------------------------------------------------------------------


def _drawing(view: View) -> str:
    labels = {arrow: _label(arrow) for arrow in view.arrows}
    gap = 80.0 + _DETAIL_CHAR_WIDTH * max((_columns(text) for text in labels.values()), default=0)
    layout = layered(
        {vertex.id: (_width(vertex), _HEIGHT) for vertex in view.vertices},
        [(arrow.src, arrow.dst) for arrow in view.arrows],
        layer_gap=gap,
    )
    names = {vertex.id: vertex.name for vertex in view.vertices}
    boxes = {
        name: Box(round(box.x + _MARGIN, 1), round(box.y + _MARGIN, 1), box.width, box.height)
        for name, box in layout.boxes.items()
    }
    width, height = layout.width + 2 * _MARGIN, layout.height + 2 * _MARGIN
    lines = [
        f'<svg id="drawing" viewBox="0 0 {width:.0f} {height:.0f}" role="group" aria-label="Drawing">',
        _ARROW_HEAD,
        '<g id="world">',
        *(_arrow(arrow, names, boxes, labels[arrow]) for arrow in view.arrows),
        *(_vertex(vertex, boxes[vertex.id]) for vertex in view.vertices),
        "</g>",
        "</svg>",
    ]
    return "\n".join(lines)


def _columns(text: str) -> int:
    """Columns that a text takes in a monospaced font."""
    return sum(2 if unicodedata.east_asian_width(char) in "WF" else 1 for char in text)


def _shortened(text: str, limit: int) -> str:
    """The text with its middle left out: names of a robot begin and end with what matters."""
    shown = printable(text)
    if len(shown) <= limit:
        return shown
    half = (limit - 1) // 2
    return f"{shown[:half]}…{shown[-half:]}"


def _width(vertex: Vertex) -> float:
    name = _columns(_shortened(vertex.name, _MAX_NAME)) * _CHAR_WIDTH
    detail = _columns(_shortened(vertex.detail, _MAX_NAME)) * _DETAIL_CHAR_WIDTH
    return round(max(name, detail) + _PADDING, 1)


def _vertex(vertex: Vertex, box: Box) -> str:
    name, detail = _text(vertex.name), _text(vertex.detail)
    radius = 5 if vertex.kind is Kind.NODE else box.height / 2
    x = round(box.x + box.width / 2, 1)
    # Everything visible is placed by attributes: the page's policy knows no inline style.
    return (
        f'<g class="vertex {vertex.kind.value}" tabindex="0" role="button" '
        f'aria-label="{vertex.kind.value} {name}" data-id="{vertex.id}" data-name="{name}" '
        f'data-detail="{detail}"><title>{name}\n{detail}</title>'
        f'<rect x="{box.x}" y="{box.y}" width="{box.width}" height="{box.height}" rx="{radius:g}"/>'
        f'<text x="{x}" y="{box.y + 16:.1f}" text-anchor="middle">'
        f"{escape(_shortened(vertex.name, _MAX_NAME))}</text>"
        f'<text class="detail" x="{x}" y="{box.y + 30:.1f}" text-anchor="middle">'
        f"{escape(_shortened(vertex.detail, _MAX_NAME))}</text></g>"
    )


def _label(arrow: Arrow) -> str:
    if not arrow.topics:
        return ""
    more = f" +{len(arrow.topics) - 1}" if len(arrow.topics) > 1 else ""
    return _shortened(arrow.topics[0].topic, _MAX_LABEL) + more


def _arrow(arrow: Arrow, names: dict[str, str], boxes: dict[str, Box], label: str) -> str:
    path, (x, y) = _curve(boxes[arrow.src], boxes[arrow.dst])
    flows = [f"{_text(key.topic)} : {_text(key.msg_type)}" for key in arrow.topics]
    title = "\n".join([f"{_text(names[arrow.src])} → {_text(names[arrow.dst])}", *flows])
    text = f'<text class="label" x="{x:.1f}" y="{y:.1f}">{escape(label)}</text>' if label else ""
    return (
        f'<g class="arrow" data-from="{arrow.src}" data-to="{arrow.dst}">'
        f'<title>{title}</title><path d="{path}"/>{text}</g>'
    )


def _curve(src: Box, dst: Box) -> tuple[str, tuple[float, float]]:
    """A path from the right side of one box to the left side of another, and its middle."""
    x1, y1 = src.x + src.width, src.y + src.height / 2
    x2, y2 = dst.x, dst.y + dst.height / 2
    bow = 0.0
    if x2 > x1:
        reach = (x2 - x1) / 2
    else:  # leads back: leave to the right, pass below, come from the left
        reach = 60.0
        bow = max(src.height, dst.height) + 12.0
    c1, c2 = (x1 + reach, y1 + bow), (x2 - reach, y2 + bow)
    middle = (x1 + 3 * c1[0] + 3 * c2[0] + x2) / 8, (y1 + 3 * c1[1] + 3 * c2[1] + y2) / 8
    path = f"M{x1:.1f} {y1:.1f}C{c1[0]:.1f} {c1[1]:.1f} {c2[0]:.1f} {c2[1]:.1f} {x2:.1f} {y2:.1f}"
    return path, (middle[0], middle[1] - 4)


# -- tables ----------------------------------------------------------------------------------------


def _tables(graph: GraphSnapshot) -> str:
    nodes = [
        (
            _text(node.name),
            _text(f"{node.ip}:{node.port}"),
            _list([f"{key.topic} : {key.msg_type}" for key in node.publishes]),
            _list([f"{key.topic} : {key.msg_type}" for key in node.subscribes]),
        )
        for node in graph.nodes
    ]
    users: dict[TopicKey, tuple[list[str], list[str]]] = defaultdict(lambda: ([], []))
    for node in graph.nodes:
        for side, keys in enumerate((node.publishes, node.subscribes)):
            for key in keys:
                users[key][side].append(node.name)
    topics = [
        (_text(key.topic), _text(key.msg_type), _list(users[key][0]), _list(users[key][1]))
        for key in sorted(users)
    ]
    tables = [
        _table("Nodes", ("Node", "Address", "Publishes", "Subscribes"), nodes),
        _table("Topics", ("Topic", "Type", "Publishers", "Subscribers"), topics),
    ]
    if graph.services:
        services = [
            (_text(service.name), _text(service.type_name), _text(service.node))
            for service in graph.services
        ]
        tables.append(_table("Services", ("Service", "Type", "Node"), services))
    return "\n".join(tables)


def _list(items: Sequence[str]) -> str:
    if not items:
        return '<span class="none">nothing</span>'
    return "<ul>" + "".join(f"<li>{_text(item)}</li>" for item in items) + "</ul>"


def _table(title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    head = "".join(f'<th scope="col">{cell}</th>' for cell in header)
    body = "\n".join(
        f'<tr><th scope="row">{first}</th>'
        + "".join(f"<td>{cell}</td>" for cell in further)
        + "</tr>"
        for first, *further in rows
    )
    return (
        f'<h2>{title}</h2>\n<div class="wide"><table>\n<thead><tr>{head}</tr></thead>\n'
        f"<tbody>\n{body}\n</tbody></table></div>"
    )
