"""``simple-ros topic list``, ``info`` and ``find``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from simple_ros.cli.lookup import address_text, ask, dotted, find_topic
from simple_ros.cli.options import (
    FilterArgument,
    JsonOption,
    MasterOption,
    Style,
    StyleOption,
    TopicArgument,
    TypeArgument,
)
from simple_ros.cli.text import columns, json_line, say

if TYPE_CHECKING:
    from simple_ros.rpc import ros_rpc_pb2 as ros

__all__ = ["find", "info", "list_topics", "topics_of_type", "written_info", "written_list"]


def list_topics(
    filter: FilterArgument = "",  # noqa: A002
    json: JsonOption = False,
    style: StyleOption = Style.READABLE,
    master: MasterOption = None,
) -> None:
    """Print the topics and their types."""
    topics = ask(master, lambda client: client.get_topics(filter.lstrip("/")))
    if json:
        rows = sorted((topic.topic_name, topic.msg_type) for topic in topics)
        say(json_line([{"topic": name, "msg": msg_type} for name, msg_type in rows]))
    elif topics or style is Style.CPP:
        say(written_list(topics, style))


def written_list(topics: list[ros.TopicInfo], style: Style) -> str:
    """Topics and types as text; the C++ style keeps the Master's order."""
    if style is Style.CPP:
        lines = [f" * {topic.topic_name} [{topic.msg_type}]" for topic in topics]
        return "\n".join(["Active topics:", *lines])
    return columns(sorted((topic.topic_name, topic.msg_type) for topic in topics))


def info(
    topic: TopicArgument,
    json: JsonOption = False,
    style: StyleOption = Style.READABLE,
    master: MasterOption = None,
) -> None:
    """Print a topic's type, and who publishes and subscribes."""
    name, found = ask(master, lambda client: find_topic(client, topic))
    say(json_line(_info_json(name, found)) if json else written_info(name, found, style))


def written_info(name: str, found: ros.GetTopicInfoResponse, style: Style) -> str:
    """A topic and its nodes as text."""
    return (_cpp_info if style is Style.CPP else _readable_info)(name, found)


def _readable_info(name: str, found: ros.GetTopicInfoResponse) -> str:
    lines = [f"Topic: {name}", f"Type: {found.msg_type}"]
    for title, nodes in (("Publishers", found.publishers), ("Subscribers", found.subscribers)):
        rows = sorted((f"  {node.node_name}", address_text(node)) for node in nodes)
        lines += [f"{title}:", columns(rows)] if rows else [f"{title}: none"]
    return "\n".join(lines)


def _cpp_info(name: str, found: ros.GetTopicInfoResponse) -> str:
    lines = [f"Topic: {name}", f"Type: {found.msg_type}"]
    for title, nodes in (("Publishers", found.publishers), ("Subscribers", found.subscribers)):
        lines.append(f"{title}: {'' if nodes else 'None'}")
        lines += [f"  * {node.node_name} ({node.ip}:{node.port})" for node in nodes]
    return "\n".join(lines)


def _info_json(name: str, found: ros.GetTopicInfoResponse) -> dict[str, Any]:
    def listed(nodes: Any) -> list[dict[str, Any]]:
        rows = sorted((node.node_name, node.ip, node.port) for node in nodes)
        return [{"name": name, "ip": ip, "port": port} for name, ip, port in rows]

    return {
        "topic": name,
        "msg": found.msg_type,
        "publishers": listed(found.publishers),
        "subscribers": listed(found.subscribers),
    }


def find(
    msg_type: TypeArgument,
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Print the topics that carry a type; nothing if there are none."""
    topics = topics_of_type(ask(master, lambda client: client.get_topics()), msg_type)
    if json:
        say(json_line(topics))
    elif topics:
        say("\n".join(topics))


def topics_of_type(topics: list[ros.TopicInfo], spelling: str) -> list[str]:
    """Names of the topics that carry a type, which need not be known here if spelled in full.

    Raises:
        UnknownMessageType: No topic carries it, and nothing is known by that name.
    """
    from simple_ros.msg.registry import resolve_type_name

    names = (spelling, dotted(spelling))
    foreign = sorted(topic.topic_name for topic in topics if topic.msg_type in names)
    if foreign:
        return foreign
    full_name = resolve_type_name(spelling)
    return sorted(topic.topic_name for topic in topics if topic.msg_type == full_name)
