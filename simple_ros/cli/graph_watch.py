"""``simple-ros graph --watch``: a line for every change."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from simple_ros.cli.graph_formats import Format, shown, written
from simple_ros.cli.text import json_line, say

if TYPE_CHECKING:
    from simple_ros.graph import GraphChange, GraphSnapshot

__all__ = ["change_json", "change_line", "watch"]

_DOES = {"publisher": "publishes", "subscriber": "subscribes", "service": "provides"}


async def watch(master: str | None, format: Format, filter: str) -> None:  # noqa: A002
    """Print the graph, then each change that has to do with ``filter``, until cancelled."""
    from simple_ros.graph import GraphChange
    from simple_ros.graph_view import filtered
    from simple_ros.names import canonical
    from simple_ros.net.master_client import MasterClient

    as_json, wanted = format is Format.JSON, canonical(filter)
    async with MasterClient(master) as client:
        async for event in client.watch_graph():
            if not isinstance(event, GraphChange):
                graph = filtered(event, filter) if filter else event
                say(_snapshot_json(graph) if as_json else shown(written(graph, format), format))
            elif wanted in event.node or (event.key is not None and wanted in event.key.topic):
                say(change_json(event) if as_json else shown(change_line(event), format))


def change_line(change: GraphChange) -> str:
    """A change for people."""
    what, _, happened = change.kind.value.partition("_")
    sign = "+" if happened == "added" else "-"
    if change.key is None:
        return f"{sign} node {change.node} (ip={change.ip}, port={change.port})"
    does = _DOES[what]
    return f"{sign} {change.node} {does} {change.key.topic} : {change.key.msg_type}"


def change_json(change: GraphChange) -> str:
    """A change for programs."""
    from simple_ros.graph import ChangeKind

    line: dict[str, Any] = {"event": change.kind.value, "name": change.node}
    line |= {"ip": change.ip, "port": change.port}
    if change.key is not None:
        is_service = change.kind in (ChangeKind.SERVICE_ADDED, ChangeKind.SERVICE_REMOVED)
        name, type_name = ("service", "type") if is_service else ("topic", "msg")
        line |= {name: change.key.topic, type_name: change.key.msg_type}
    return json_line(line)


def _snapshot_json(graph: GraphSnapshot) -> str:
    whole = json.loads(written(graph, Format.JSON))
    return json_line({"event": "snapshot", **whole})
