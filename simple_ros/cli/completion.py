"""Names of nodes, topics, services, parameters and types for the shell's Tab key.

A key press must not hang, and must not print: without a Master, or with one that does not answer at
once, there is nothing to offer. Names come from the network and the shell scripts that typer
installs evaluate what they are given, so only names that keep the naming rules are offered; those hold no character
that means anything to a shell.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterable
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from simple_ros.net.master_client import MasterClient

__all__ = [
    "complete_actions",
    "complete_nodes",
    "complete_parameters",
    "complete_services",
    "complete_topics",
    "complete_types",
    "offered",
]

_DEADLINE_S = 0.5


def complete_nodes(context: typer.Context, incomplete: str) -> list[str]:
    """Names of nodes that begin so."""
    from simple_ros.names import node_name

    return offered(_asked(context, _node_names), incomplete, node_name)


def complete_topics(context: typer.Context, incomplete: str) -> list[str]:
    """Names of topics that begin so."""
    from simple_ros.names import topic_name

    return offered(_asked(context, _topic_names), incomplete, topic_name)


def complete_parameters(context: typer.Context, incomplete: str) -> list[str]:
    """Names of parameters that begin so."""
    from simple_ros.names import parameter_name

    return offered(_asked(context, _parameter_names), incomplete, parameter_name)


def complete_services(context: typer.Context, incomplete: str) -> list[str]:
    """Names of services that begin so."""
    from simple_ros.names import topic_name

    return offered(_asked(context, _service_names), incomplete, topic_name)


def complete_actions(context: typer.Context, incomplete: str) -> list[str]:
    """Names of actions that begin so."""
    from simple_ros.names import topic_name

    return offered(_asked(context, _action_names), incomplete, topic_name)


def complete_types(incomplete: str) -> list[str]:
    """Message types of this installation that begin so, in the spelling that was begun."""
    from simple_ros.msg.registry import message_types

    separator = "/" if "/" in incomplete else "."
    names = (name.replace(".", separator) for name in message_types())
    return [name for name in names if name.startswith(incomplete)]


def offered(names: Iterable[str], incomplete: str, check: Callable[[str], str]) -> list[str]:
    """Those of the names that go on from what is typed, with its leading slash if it has one.

    Args:
        names: As the Master has them.
        incomplete: What is typed.
        check: Raises `InvalidName` for a name that must not reach a shell.
    """
    slash = "/" if incomplete.startswith("/") else ""
    start = incomplete.removeprefix("/")
    return sorted(
        slash + name for name in set(names) if name.startswith(start) and _is_valid(check, name)
    )


def _is_valid(check: Callable[[str], str], name: str) -> bool:
    from simple_ros.errors import InvalidName

    try:
        check(name)
    except InvalidName:
        return False
    return True


def _asked(
    context: typer.Context, names: Callable[[MasterClient], Awaitable[list[str]]]
) -> list[str]:
    """What the Master answers, or nothing."""
    import grpc

    from simple_ros.errors import SimpleRosError
    from simple_ros.net.master_client import MasterClient

    async def ask() -> list[str]:
        async with (
            asyncio.timeout(_DEADLINE_S),
            MasterClient(context.params.get("master")) as client,
        ):
            return await names(client)

    try:
        return asyncio.run(ask())
    except (SimpleRosError, grpc.RpcError, TimeoutError):
        return []  # a word about it would stand in the middle of the user's line


async def _node_names(client: MasterClient) -> list[str]:
    return [node.node_name for node in await client.get_nodes()]


async def _parameter_names(client: MasterClient) -> list[str]:
    from simple_ros.parameters.calls import ParameterCalls

    return list(await ParameterCalls(client).list())


async def _topic_names(client: MasterClient) -> list[str]:
    return [topic.topic_name for topic in await client.get_topics()]


async def _action_names(client: MasterClient) -> list[str]:
    services = await _service_names(client)
    return [
        name.removesuffix("/_action/send_goal")
        for name in services
        if name.endswith("/_action/send_goal")
    ]


async def _service_names(client: MasterClient) -> list[str]:
    from simple_ros.rpc import methods
    from simple_ros.rpc import services_pb2 as srv

    answer = await client.call(methods.GET_SERVICES, srv.GetServicesRequest())
    return [service.name for service in answer.services]
