"""What the Master knows of actions: those services that are called send_goal and name an action's types."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from simple_ros.cli.completion import complete_actions
from simple_ros.cli.lookup import UnknownName

if TYPE_CHECKING:
    from simple_ros.msg.interfaces import ActionType
    from simple_ros.net.master_client import MasterClient
    from simple_ros.rpc import services_pb2 as srv

__all__ = ["ActionArgument", "actions_of", "find_action", "name_of", "type_text", "types_of"]

_SEND_GOAL = "/_action/send_goal"

ActionArgument = Annotated[
    str,
    typer.Argument(metavar="ACTION", help="Name of the action.", autocompletion=complete_actions),
]


def name_of(service: srv.ServiceInfo) -> str:
    """The name of an action, by its service send_goal."""
    return service.name.removesuffix(_SEND_GOAL)


def type_text(service: srv.ServiceInfo) -> str:
    """The type of an action in one word, or its three messages if they are called differently."""
    types = service.action
    stem = types.goal_type.removesuffix("Goal")
    if (types.result_type, types.feedback_type) == (f"{stem}Result", f"{stem}Feedback"):
        return stem
    return f"{types.goal_type} -> {types.result_type}, {types.feedback_type}"


async def actions_of(client: MasterClient) -> list[srv.ServiceInfo]:
    """The services send_goal of all actions, by name."""
    from simple_ros.rpc import methods
    from simple_ros.rpc import services_pb2 as srv

    answer = await client.call(methods.GET_SERVICES, srv.GetServicesRequest(filter=_SEND_GOAL))
    return [
        service
        for service in answer.services
        if service.name.endswith(_SEND_GOAL) and service.HasField("action")
    ]


async def find_action(client: MasterClient, name: str) -> srv.ServiceInfo:
    """The service send_goal of an action, whatever the leading slash of its name.

    Raises:
        UnknownName: The Master knows no such action.
        InvalidName: Nor can it, by the rules for names.
    """
    from simple_ros.names import canonical, resolve

    known = {name_of(service): service for service in await actions_of(client)}
    found = known.get(canonical(name))
    if found is None:
        resolve(name, kind="action")
        raise UnknownName("action", name, known)
    return found


async def types_of(client: MasterClient, service: srv.ServiceInfo) -> ActionType[Any, Any, Any]:
    """The classes of an action's messages, known here or to the Master.

    Raises:
        UnknownMessageType: Known to neither.
    """
    from simple_ros.msg.interfaces import ActionType

    types = service.action
    names = (types.goal_type, types.result_type, types.feedback_type)
    goal, result, feedback = [await client.message_class(name) for name in names]
    return ActionType(goal, result, feedback)
