"""``simple-ros node list`` and ``info``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from simple_ros.cli.lookup import address_text, ask, find_node, node_json
from simple_ros.cli.options import (
    FilterArgument,
    JsonOption,
    MasterOption,
    NodeArgument,
    Style,
    StyleOption,
)
from simple_ros.cli.text import columns, json_line, say

if TYPE_CHECKING:
    from simple_ros.rpc import ros_rpc_pb2 as ros

__all__ = ["info", "list_nodes", "written_info", "written_list"]

# Ways inside one host, which every node has: of no use to a reader.
_SAME_HOST = ("unix://", "shm://")


def list_nodes(
    filter: FilterArgument = "",  # noqa: A002
    json: JsonOption = False,
    style: StyleOption = Style.READABLE,
    master: MasterOption = None,
) -> None:
    """Print the nodes and their addresses."""
    nodes = ask(master, lambda client: client.get_nodes(filter.lstrip("/")))
    if json:
        say(json_line([node_json(node) for node in _sorted(nodes)]))
    elif nodes or style is Style.CPP:
        say(written_list(nodes, style))


def written_list(nodes: list[ros.NodeInfo], style: Style) -> str:
    """Nodes and addresses as text; the C++ style keeps the Master's order."""
    if style is Style.CPP:
        lines = [f" * {node.node_name} ({node.ip}:{node.port})" for node in nodes]
        return "\n".join(["Active nodes:", *lines, f"Total nodes: {len(nodes)}"])
    return columns([(node.node_name, address_text(node)) for node in _sorted(nodes)])


def _sorted(nodes: list[ros.NodeInfo]) -> list[ros.NodeInfo]:
    return sorted(nodes, key=lambda node: node.node_name)


def info(
    node: NodeArgument,
    json: JsonOption = False,
    style: StyleOption = Style.READABLE,
    master: MasterOption = None,
) -> None:
    """Print where a node is, what it publishes and what it subscribes to."""
    found = ask(master, lambda client: find_node(client, node))
    say(json_line(_info_json(found)) if json else written_info(found, style))


def written_info(found: ros.GetNodeInfoResponse, style: Style) -> str:
    """A node and its topics as text."""
    return _cpp_info(found) if style is Style.CPP else _readable_info(found)


def _readable_info(found: ros.GetNodeInfoResponse) -> str:
    # That it can be reached by a Unix socket on its own host is nothing to look at.
    others = [item for item in found.node_info.addresses if not item.startswith(_SAME_HOST)]
    further = f" (also {', '.join(others)})" if others else ""
    lines = [
        f"Node: {found.node_info.node_name}",
        f"Address: {address_text(found.node_info)}{further}",
    ]
    for title, topics in (("Publishes", found.publishes), ("Subscribes", found.subscribes)):
        rows = sorted((f"  {topic.topic_name}", topic.msg_type) for topic in topics)
        lines += [f"{title}:", columns(rows)] if rows else [f"{title}: nothing"]
    return "\n".join(lines)


def _cpp_info(found: ros.GetNodeInfoResponse) -> str:
    node = found.node_info
    lines = [f"Node: {node.node_name}", f" - IP: {node.ip}", f" - Port: {node.port}"]
    for title, topics in (("Published", found.publishes), ("Subscribed", found.subscribes)):
        entries = [f"  * {topic.topic_name} ({topic.msg_type})" for topic in topics]
        lines += [f"{title} topics: ", *(entries or ["  None"])]
    return "\n".join(lines)


def _info_json(found: ros.GetNodeInfoResponse) -> dict[str, Any]:
    def listed(topics: Any) -> list[dict[str, str]]:
        pairs = sorted((topic.topic_name, topic.msg_type) for topic in topics)
        return [{"topic": name, "msg": msg_type} for name, msg_type in pairs]

    topics = {"publishes": listed(found.publishes), "subscribes": listed(found.subscribes)}
    return node_json(found.node_info) | topics
