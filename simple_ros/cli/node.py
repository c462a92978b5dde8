"""``simple-ros node``: the nodes of the graph, one by one."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Annotated, Any

import typer

from simple_ros.cli.output import (
    JsonOption,
    MasterOption,
    Style,
    StyleOption,
    UnknownName,
    columns,
    json_line,
    say,
    spread,
)

if TYPE_CHECKING:
    from simple_ros.net.master_client import MasterClient
    from simple_ros.rpc import ros_rpc_pb2 as ros

__all__ = ["app", "ping_summary", "written_info", "written_list"]

app = typer.Typer(help="Look at the nodes of the graph.", no_args_is_help=True)

_PING_TIMEOUT_S = 2.0

NodeArgument = Annotated[str, typer.Argument(metavar="NODE", help="Name of the node.")]


# -- list ------------------------------------------------------------------------------------------


@app.command("list")
def list_nodes(
    filter: Annotated[  # noqa: A002
        str, typer.Argument(metavar="[FILTER]", help="Only names that contain this.")
    ] = "",
    json: JsonOption = False,
    style: StyleOption = Style.READABLE,
    master: MasterOption = None,
) -> None:
    """Print the nodes and their addresses."""
    from simple_ros import aio

    async def main() -> None:
        from simple_ros.net.master_client import MasterClient

        async with MasterClient(master) as client:
            nodes = await client.get_nodes(filter.lstrip("/"))
        if json:
            say(json_line([_node_json(node) for node in _sorted(nodes)]))
        elif nodes or style is Style.CPP:
            say(written_list(nodes, style))

    aio.run(main())


def written_list(nodes: list[ros.NodeInfo], style: Style) -> str:
    """Nodes and addresses as text; the C++ style keeps the Master's order."""
    if style is Style.CPP:
        lines = [f" * {node.node_name} ({node.ip}:{node.port})" for node in nodes]
        return "\n".join(["Active nodes:", *lines, f"Total nodes: {len(nodes)}"])
    return columns([(node.node_name, _address(node)) for node in _sorted(nodes)])


def _sorted(nodes: list[ros.NodeInfo]) -> list[ros.NodeInfo]:
    return sorted(nodes, key=lambda node: node.node_name)


def _address(node: ros.NodeInfo) -> str:
    from simple_ros.net.addresses import join_address

    return join_address(node.ip, node.port)


def _node_json(node: ros.NodeInfo) -> dict[str, Any]:
    return {
        "name": node.node_name,
        "ip": node.ip,
        "port": node.port,
        "addresses": list(node.addresses),
    }


# -- info ------------------------------------------------------------------------------------------


@app.command("info")
def info(
    node: NodeArgument,
    json: JsonOption = False,
    style: StyleOption = Style.READABLE,
    master: MasterOption = None,
) -> None:
    """Print where a node is, what it publishes and what it subscribes to."""
    from simple_ros import aio

    async def main() -> None:
        from simple_ros.net.master_client import MasterClient

        async with MasterClient(master) as client:
            found = await _found(client, node)
        say(json_line(_info_json(found)) if json else written_info(found, style))

    aio.run(main())


async def _found(client: MasterClient, name: str) -> ros.GetNodeInfoResponse:
    """What the Master knows of a node, whatever its leading slash.

    Raises:
        UnknownName: Nothing.
    """
    from simple_ros.names import canonical

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
    raise UnknownName("node", name, names)


def written_info(found: ros.GetNodeInfoResponse, style: Style) -> str:
    """A node and its topics as text."""
    return _cpp_info(found) if style is Style.CPP else _readable_info(found)


def _readable_info(found: ros.GetNodeInfoResponse) -> str:
    further = f" (also {', '.join(found.node_info.addresses)})" if found.node_info.addresses else ""
    lines = [f"Node: {found.node_info.node_name}", f"Address: {_address(found.node_info)}{further}"]
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
    return _node_json(found.node_info) | topics


# -- ping ------------------------------------------------------------------------------------------


@app.command("ping")
def ping(
    node: NodeArgument,
    count: Annotated[
        int | None, typer.Option("-n", "--count", min=1, help="End after so many.")
    ] = None,
    interval: Annotated[float, typer.Option(min=0.0, help="Seconds between two.")] = 1.0,
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Measure how long it takes to connect to a node's port, until Ctrl-C.

    Code 1: nobody listened each time of -n.
    """
    from simple_ros import aio

    times: list[float | None] = []

    async def main() -> None:
        from simple_ros.net.master_client import MasterClient

        async with MasterClient(master) as client:
            info = (await _found(client, node)).node_info
        while True:
            taken_ms, problem = await _connect(info.ip, info.port)
            times.append(taken_ms)
            say(_ping_json(info, taken_ms) if json else _ping_line(info, taken_ms, problem))
            if len(times) == count:
                return
            await asyncio.sleep(interval)

    aio.run(main())
    if times and not json:
        say(ping_summary(times))
    if times and len(times) == count and not any(taken is not None for taken in times):
        raise typer.Exit(1)


async def _connect(host: str, port: int) -> tuple[float | None, str]:
    """Milliseconds until the connection stood, or None and why it does not."""
    loop = asyncio.get_running_loop()
    start = loop.time()
    try:
        async with asyncio.timeout(_PING_TIMEOUT_S):
            _, writer = await asyncio.open_connection(host, port)
    except ConnectionRefusedError:
        return None, "nobody listens"
    except TimeoutError:
        return None, f"no answer within {_PING_TIMEOUT_S:g} s"
    except OSError as error:
        return None, error.strerror or str(error)
    taken_ms = (loop.time() - start) * 1e3
    writer.close()
    return taken_ms, ""


def _ping_line(info: ros.NodeInfo, taken_ms: float | None, problem: str) -> str:
    result = problem if taken_ms is None else f"{taken_ms:.3f} ms"
    return f"{info.node_name} at {_address(info)}: {result}"


def _ping_json(info: ros.NodeInfo, taken_ms: float | None) -> str:
    return json_line(_node_json(info) | {"listens": taken_ms is not None, "connect_ms": taken_ms})


def ping_summary(times_ms: list[float | None]) -> str:
    """How many of the attempts were answered, and how fast."""
    answered = [taken for taken in times_ms if taken is not None]
    line = f"{len(answered)} of {len(times_ms)} answered"
    if not answered:
        return line
    found = spread(answered)
    return f"{line}: mean {found.mean:.3f} ms min {found.minimum:.3f} ms max {found.maximum:.3f} ms"
