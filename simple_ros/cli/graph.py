"""``simple-ros graph``: who is there and what flows between them."""

from __future__ import annotations

import json
from enum import Enum
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from simple_ros.graph import GraphChange, GraphSnapshot
    from simple_ros.net.master_client import MasterClient

__all__ = ["Format", "command"]


class Format(Enum):
    """How a graph is written."""

    READABLE = "readable"
    DOT = "dot"
    JSON = "json"


def command(
    format: Annotated[  # noqa: A002
        Format, typer.Option(help="For people, Graphviz or programs.")
    ] = Format.READABLE,
    watch: Annotated[
        bool, typer.Option("--watch", help="Go on with a line for every change, until Ctrl-C.")
    ] = False,
    master: Annotated[
        str | None,
        typer.Option(
            metavar="HOST:PORT",
            help="Where the Master is.",
            show_default="$SIMPLE_ROS_MASTER, else localhost:50051",
        ),
    ] = None,
) -> None:
    """Print who is there and what flows from whom to whom."""
    from simple_ros import aio

    if watch and format is Format.DOT:
        raise typer.BadParameter("--watch writes readable or json, not dot")
    aio.run(_watch(master, format) if watch else _print_once(master, format))


async def _print_once(master: str | None, format: Format) -> None:  # noqa: A002
    from simple_ros.net.master_client import ForeignMaster, MasterClient
    from simple_ros.rpc import master_pb2

    numbers = {
        Format.READABLE: master_pb2.GRAPH_FORMAT_READABLE,
        Format.DOT: master_pb2.GRAPH_FORMAT_DOT,
        Format.JSON: master_pb2.GRAPH_FORMAT_JSON,
    }
    async with MasterClient(master) as client:
        try:
            text = await client.export_graph(numbers[format])
        except ForeignMaster:
            text = _written(await _collected(client), format)
    _say(text)


def _written(graph: GraphSnapshot, format: Format) -> str:  # noqa: A002
    from simple_ros.graph import to_dot, to_json, to_readable_string

    writers = {
        Format.READABLE: to_readable_string,
        Format.DOT: to_dot,
        Format.JSON: to_json,
    }
    return writers[format](graph)


async def _collected(client: MasterClient) -> GraphSnapshot:
    """The graph from the calls of a C++ Master, one after the other: it cannot take more."""
    from simple_ros.graph import GraphNode, GraphSnapshot, TopicKey, edges_between

    def keys(topics: Any) -> tuple[TopicKey, ...]:
        return tuple(sorted(TopicKey(topic.topic_name, topic.msg_type) for topic in topics))

    nodes = []
    for info in sorted(await client.get_nodes(), key=lambda info: info.node_name):
        details = await client.get_node_info(info.node_name)
        if details is not None:
            nodes.append(
                GraphNode(
                    info.node_name,
                    info.ip,
                    info.port,
                    keys(details.publishes),
                    keys(details.subscribes),
                )
            )
    return GraphSnapshot(tuple(nodes), edges_between(tuple(nodes)))


# -- watching --------------------------------------------------------------------------------------


async def _watch(master: str | None, format: Format) -> None:  # noqa: A002
    from simple_ros.graph import GraphChange
    from simple_ros.net.master_client import MasterClient

    as_json = format is Format.JSON
    async with MasterClient(master) as client:
        async for event in client.watch_graph():
            if isinstance(event, GraphChange):
                _say(_change_json(event) if as_json else _change_line(event))
            else:
                _say(_snapshot_json(event) if as_json else _written(event, format))


def _change_line(change: GraphChange) -> str:
    what, _, happened = change.kind.value.partition("_")
    sign = "+" if happened == "added" else "-"
    if change.key is None:
        return f"{sign} node {change.node} (ip={change.ip}, port={change.port})"
    does = {"publisher": "publishes", "subscriber": "subscribes"}[what]
    return f"{sign} {change.node} {does} {change.key.topic} : {change.key.msg_type}"


def _change_json(change: GraphChange) -> str:
    line: dict[str, Any] = {"event": change.kind.value, "name": change.node}
    line |= {"ip": change.ip, "port": change.port}
    if change.key is not None:
        line |= {"topic": change.key.topic, "msg": change.key.msg_type}
    return json.dumps(line, ensure_ascii=False)


def _snapshot_json(graph: GraphSnapshot) -> str:
    whole = json.loads(_written(graph, Format.JSON))
    return json.dumps({"event": "snapshot", **whole}, ensure_ascii=False)


def _say(text: str) -> None:
    print(text.removesuffix("\n"), flush=True)
