"""What the Master knows of a node or a topic, whatever the spelling of its name."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, TypeVar

import typer

from simple_ros.errors import SimpleRosError

if TYPE_CHECKING:
    from simple_ros.net.master_client import MasterClient
    from simple_ros.rpc import ros_rpc_pb2 as ros

__all__ = ["UnknownName", "address_text", "ask", "dotted", "find_node", "find_topic", "node_json"]

Answer = TypeVar("Answer")


class UnknownName(SimpleRosError, LookupError):
    """The Master knows no such node or topic.

    Attributes:
        kind: ``"node"`` or ``"topic"``.
        name: The name asked for.
        near: Known names that look like it.
    """

    def __init__(self, kind: str, name: str, known: Iterable[str] = ()) -> None:
        self.kind = kind
        self.name = name
        names = sorted(set(known))
        alike = get_close_matches(name, names, n=3, cutoff=0.6)
        holding = [other for other in names if name and name in other]
        self.near = tuple(dict.fromkeys(alike + holding))[:3]
        near = " or ".join(map(repr, self.near))
        hint = f"did you mean {near}?" if near else f"see 'simple-ros {kind} list'"
        super().__init__(f"no {kind} {name!r}; {hint}")


def ask(master: str | None, question: Callable[[MasterClient], Awaitable[Answer]]) -> Answer:
    """What the Master answers; Ctrl-C ends the program.

    Raises:
        MasterUnavailable: Nobody answers.
    """
    from simple_ros import aio

    async def main() -> tuple[Answer]:
        async with aio.MasterClient(master) as client:
            return (await question(client),)

    answer = aio.run(main())
    if answer is None:
        raise typer.Exit
    return answer[0]


async def find_node(client: MasterClient, name: str) -> ros.GetNodeInfoResponse:
    """A node and its topics, whatever the leading slash of its name.

    Raises:
        UnknownName: The Master knows no such node.
        InvalidName: Nor can it, by the rules for names.
    """
    from simple_ros.names import canonical, node_name

    wanted = canonical(name)
    details = await client.get_node_info(wanted)
    if details is not None:
        return details
    names = [node.node_name for node in await client.get_nodes()]
    for spelling in names:
        if canonical(spelling) == wanted:
            details = await client.get_node_info(spelling)
            if details is not None:
                return details
    node_name(name)
    raise UnknownName("node", name, names)


async def find_topic(client: MasterClient, topic: str) -> tuple[str, ros.GetTopicInfoResponse]:
    """The Master's spelling of a topic and what it knows of it, whatever the leading slash.

    Raises:
        UnknownName: The Master knows no such topic.
        InvalidName: Nor can it, by the rules for names.
    """
    from simple_ros.names import canonical, topic_name
    from simple_ros.net.master_client import TopicNotFound

    wanted = canonical(topic)
    try:
        return wanted, await client.get_topic_info(wanted)
    except TopicNotFound:
        names = [known.topic_name for known in await client.get_topics()]
    for name in names:
        if canonical(name) == wanted and name != wanted:
            try:
                return name, await client.get_topic_info(name)
            except TopicNotFound:
                break  # it has gone meanwhile
    topic_name(topic)
    raise UnknownName("topic", topic, names)


def address_text(node: ros.NodeInfo) -> str:
    """Where a node listens, as ``host:port``."""
    from simple_ros.net.addresses import join_address

    return join_address(node.ip, node.port)


def node_json(node: ros.NodeInfo) -> dict[str, Any]:
    """A node as a value for JSON."""
    return {
        "name": node.node_name,
        "ip": node.ip,
        "port": node.port,
        "addresses": list(node.addresses),
    }


def dotted(spelling: str) -> str:
    """Any spelling of a type as its full name, if it names the package."""
    return spelling.replace("::", ".").replace("/", ".").replace(".msg.", ".").lstrip(".")
