"""``simple-ros action list`` and ``info``."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

from simple_ros.cli.action.finding import (
    ActionArgument,
    actions_of,
    find_action,
    name_of,
    type_text,
)
from simple_ros.cli.lookup import address_text, ask, node_json
from simple_ros.cli.options import FilterArgument, JsonOption, MasterOption
from simple_ros.cli.text import columns, json_line, say
from simple_ros.cli.topic.following import cli_node

if TYPE_CHECKING:
    from simple_ros.msg.action_msgs import GoalStatusArray
    from simple_ros.rpc import services_pb2 as srv

__all__ = ["info", "list_actions", "written_info"]

_STATUS_S = 2.0
_ENDED = 4


def list_actions(
    filter: FilterArgument = "",  # noqa: A002
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Print the actions and their types."""
    wanted = filter.lstrip("/")
    found = [item for item in ask(master, actions_of) if wanted in name_of(item)]
    if json:
        say(json_line([_json(service) for service in found]))
    elif found:
        say(columns([(name_of(service), type_text(service)) for service in found]))


def _json(service: srv.ServiceInfo) -> dict[str, Any]:
    return {
        "action": name_of(service),
        "type": type_text(service),
        "goal": service.action.goal_type,
        "result": service.action.result_type,
        "feedback": service.action.feedback_type,
        "server": node_json(service.node_info),
    }


def info(action: ActionArgument, json: JsonOption = False, master: MasterOption = None) -> None:
    """Print an action's types, who executes it, and the goals that are under way."""
    from simple_ros import aio

    found = aio.run(_looked(action, master))
    if found is None:
        return
    service, status = found
    goals = [entry for entry in status.status_list if entry.status < _ENDED]
    if json:
        say(json_line(_json(service) | {"goals": [_goal_json(entry) for entry in goals]}))
    else:
        say(written_info(service, goals))


def _goal_json(entry: Any) -> dict[str, Any]:
    return {
        "goal_id": entry.goal_info.goal_id.hex(),
        "status": _state(entry),
        "accepted": entry.goal_info.stamp.ToJsonString(),
    }


def _state(entry: Any) -> str:
    name: str = type(entry).Status.Name(entry.status)
    return name.removeprefix("STATUS_")


async def _looked(action: str, master: str | None) -> tuple[srv.ServiceInfo, GoalStatusArray]:
    from simple_ros.errors import SimpleRosError
    from simple_ros.msg.action_msgs import GoalStatusArray
    from simple_ros.net.master_client import MasterClient

    async with MasterClient(master) as client:
        service = await find_action(client, action)
    topic = f"/{name_of(service)}/_action/status"
    async with cli_node("action_info", master) as node:
        subscriber = await node.subscribe(topic, GoalStatusArray)
        try:
            async with asyncio.timeout(_STATUS_S):
                return service, await subscriber.receive()
        except TimeoutError:
            server = service.node_info.node_name
            raise SimpleRosError(
                f"node {server!r} does not say which goals it has: nothing came on topic "
                f"{topic.lstrip('/')!r} within {_STATUS_S:g} s"
            ) from None


def written_info(service: srv.ServiceInfo, goals: list[Any]) -> str:
    """An action and its goals as text."""
    types = service.action
    lines = [
        f"Action: {name_of(service)}",
        f"Type: {type_text(service)}",
        f"  goal      {types.goal_type}",
        f"  result    {types.result_type}",
        f"  feedback  {types.feedback_type}",
        f"Server: {service.node_info.node_name}  {address_text(service.node_info)}",
    ]
    rows = [
        (
            f"  {entry.goal_info.goal_id.hex()}",
            _state(entry).lower(),
            f"accepted {entry.goal_info.stamp.ToJsonString()}",
        )
        for entry in goals
    ]
    return "\n".join([*lines, *(["Goals:", columns(rows)] if rows else ["Goals: none"])])
