"""Views of the graph in the languages of drawing programs: Mermaid, and Graphviz with topics.

(Graphviz with nodes only is `simple_ros.graph.to_dot`, in the format of C++ simple_ros.)
"""

from __future__ import annotations

import re

from simple_ros.graph_view import Kind, Vertex, View, printable

__all__ = ["MERMAID_MAX_ARROWS", "to_mermaid", "to_topic_dot"]

MERMAID_MAX_ARROWS = 500
"""With more arrows, Mermaid as most pages configure it shows an error and no drawing."""

_UNSAFE_IN_MERMAID = re.compile(r"[^\w ./:()-]", re.ASCII)


def to_mermaid(view: View) -> str:
    """A Mermaid flowchart, from left to right; topics are round, nodes square."""
    lines = ["flowchart LR"]
    for vertex in view.vertices:
        text = _mermaid(vertex.name)
        if vertex.kind is Kind.TOPIC:
            lines.append(f'  {vertex.id}(["{text}<br/>{_mermaid(vertex.detail)}"])')
        else:
            lines.append(f'  {vertex.id}["{text}"]')
    for arrow in view.arrows:
        topics = "<br/>".join(_mermaid(key.topic) for key in arrow.topics)
        label = f'|"{topics}"|' if topics else ""
        lines.append(f"  {arrow.src} -->{label} {arrow.dst}")
    return "\n".join(lines) + "\n"


def _mermaid(text: str) -> str:
    """Text for a quoted label: everything that might mean something is a character code.

    A space stands for an empty name, for which Mermaid has no label.
    """
    shown = printable(text) or " "
    return _UNSAFE_IN_MERMAID.sub(
        lambda match: match[0] if ord(match[0]) > 127 else f"#{ord(match[0])};", shown
    )


def to_topic_dot(view: View) -> str:
    """Graphviz text; topics are ellipses, nodes boxes."""
    lines = ["digraph RosGraph {", "  rankdir=LR;", "  node [shape=box, style=rounded];"]
    lines.extend(f"  {vertex.id} [{_dot_attributes(vertex)}];" for vertex in view.vertices)
    lines.extend(f"  {arrow.src} -> {arrow.dst};" for arrow in view.arrows)
    return "\n".join([*lines, "}"]) + "\n"


def _dot_attributes(vertex: Vertex) -> str:
    if vertex.kind is Kind.NODE:
        return f'label="{_dot(vertex.name)}"'
    return f'label="{_dot(vertex.name)}\\n{_dot(vertex.detail)}", shape=ellipse, style=solid'


def _dot(text: str) -> str:
    """Text for a quoted label: Graphviz also reads HTML's character names there."""
    escaped = printable(text).replace("&", "&amp;")
    return escaped.replace("\\", "\\\\").replace('"', '\\"')
