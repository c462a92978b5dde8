"""``simple-ros action send-goal``, ``result`` and ``cancel``.

Exit codes: 0 the goal succeeded, 1 it was aborted or rejected or something else went wrong, 2 the input
makes no sense, 130 the goal was canceled.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Annotated, Any
from uuid import UUID

import typer

from simple_ros.cli.action.display import ENDED_BADLY, Display
from simple_ros.cli.action.finding import ActionArgument, find_action, name_of, types_of
from simple_ros.cli.action.follow import follow
from simple_ros.cli.message_fields import UnknownField
from simple_ros.cli.message_input import BadMessageText, message_of
from simple_ros.cli.options import JsonOption, MasterOption
from simple_ros.cli.text import json_line, say
from simple_ros.cli.topic.following import cli_node, while_running

if TYPE_CHECKING:
    from simple_ros.actions.client import ActionClient
    from simple_ros.msg.interfaces import ActionType
    from simple_ros.node import NodeHandle

__all__ = ["cancel", "result", "send_goal"]

_ANSWER_S = 10.0

GoalIdArgument = Annotated[
    str, typer.Argument(metavar="ID", help="Id of the goal, as send-goal and info print it.")
]
TimeoutOption = Annotated[
    float | None,
    typer.Option(
        min=0.0,
        metavar="S",
        help="Wait at most so many seconds for the end of the goal, which itself goes on.",
        show_default="no limit",
    ),
]


def send_goal(
    action: ActionArgument,
    text: Annotated[str, typer.Argument(metavar="YAML", help="The goal, as YAML or JSON.")] = "{}",
    feedback: Annotated[bool, typer.Option("--feedback", "-f", help="Print feedback.")] = False,
    timeout: TimeoutOption = None,
    cancel_after: Annotated[
        float | None,
        typer.Option(min=0.0, metavar="S", help="Cancel the goal if it takes longer than that."),
    ] = None,
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Send a goal and print its result.

    Ctrl-C cancels the goal and waits for its end; a second one does not wait. The exit code is 0 if the
    goal succeeded, 1 if it was aborted or rejected, 130 if it was canceled.
    """
    show = Display(json=json)

    async def work(node: NodeHandle, name: str, kind: ActionType[Any, Any, Any]) -> int:
        goal = _message(kind, text)
        client = node.action_client(f"/{name}", kind)
        taken = show.feedback if feedback else None
        sent = await client.send_goal(goal, feedback=taken, timeout=_ANSWER_S)
        show.accepted(sent.goal_id)
        return await follow(sent, name, show, timeout, cancel_after)

    _run(action, master, work)


def _message(kind: ActionType[Any, Any, Any], text: str) -> Any:
    try:
        return message_of(kind.goal, text)
    except (BadMessageText, UnknownField) as error:
        raise typer.BadParameter(str(error)) from None


def result(
    action: ActionArgument,
    goal_id: GoalIdArgument,
    timeout: TimeoutOption = None,
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Print the result of a goal that was sent before, waiting for its end.

    The exit codes are those of send-goal. Ctrl-C ends the waiting, not the goal.
    """
    wanted = _id(goal_id)

    async def work(node: NodeHandle, name: str, kind: ActionType[Any, Any, Any]) -> int:
        goal = node.action_client(f"/{name}", kind).goal(wanted)
        return await follow(goal, name, Display(json=json), timeout, None, may_cancel=False)

    _run(action, master, work)


def cancel(
    action: ActionArgument,
    goal_id: Annotated[
        str | None, typer.Argument(metavar="[ID]", help="Id of the goal.", show_default=False)
    ] = None,
    every: Annotated[bool, typer.Option("--all", help="Every goal of the action.")] = False,
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Cancel a goal, or all of an action, whoever sent them; print those that are about to end."""
    if every == (goal_id is not None):
        raise typer.BadParameter("give the id of a goal, or --all")
    wanted = None if goal_id is None else _id(goal_id)

    async def work(node: NodeHandle, name: str, kind: ActionType[Any, Any, Any]) -> int:
        canceling = await _canceled(node.action_client(f"/{name}", kind), wanted)
        if json:
            say(json_line({"canceling": [item.hex for item in canceling]}))
        else:
            lines = [f"canceling {item.hex}" for item in canceling]
            ended = "no goals to cancel" if every else f"goal {goal_id} had ended already"
            say("\n".join(lines or [ended]))
        return 0 if canceling or every else ENDED_BADLY

    _run(action, master, work)


async def _canceled(client: ActionClient[Any, Any, Any], wanted: UUID | None) -> list[UUID]:
    if wanted is None:
        return await client.cancel_all()
    return [wanted] if await client.goal(wanted).cancel() else []


def _id(text: str) -> UUID:
    try:
        return UUID(hex=text)
    except ValueError:
        raise typer.BadParameter(
            f"{text!r} is no id of a goal: it has 32 hexadecimal digits"
        ) from None


def _run(
    action: str,
    master: str | None,
    work: Callable[[NodeHandle, str, ActionType[Any, Any, Any]], Coroutine[Any, Any, int]],
) -> None:
    """Do something with an action, and end with the exit code that it gives."""
    from simple_ros import aio

    codes: list[int] = []

    async def main() -> None:
        async with _found(action, master) as (node, name, kind):

            async def working() -> None:
                codes.append(await work(node, name, kind))

            await while_running(node, working())

    aio.run(main())
    raise typer.Exit(codes[0] if codes else 130)


@asynccontextmanager
async def _found(
    action: str, master: str | None
) -> AsyncIterator[tuple[NodeHandle, str, ActionType[Any, Any, Any]]]:
    """A node, and the action's own name and types."""
    from simple_ros.net.master_client import MasterClient

    async with MasterClient(master) as client:
        service = await find_action(client, action)
        kind = await types_of(client, service)
    async with cli_node("action", master) as node:
        yield node, name_of(service), kind
