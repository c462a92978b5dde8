"""``simple-ros topic pub``."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any

import typer

from simple_ros.cli.lookup import dotted
from simple_ros.cli.message_input import message_of
from simple_ros.cli.options import (
    CountOption,
    JsonOption,
    MasterOption,
    TopicArgument,
    TypeArgument,
)
from simple_ros.cli.text import json_line, say
from simple_ros.cli.topic.following import cli_node, while_running
from simple_ros.errors import UnknownMessageType

if TYPE_CHECKING:
    from google.protobuf.message import Message

    from simple_ros.publisher import Publisher

__all__ = ["pub"]

_SUBSCRIBER_WAIT_S = 2.0


def pub(
    topic: TopicArgument,
    msg_type: TypeArgument,
    text: Annotated[
        str, typer.Argument(metavar="YAML", help="The message, as YAML or JSON.")
    ] = "{}",
    rate: Annotated[
        float | None,
        typer.Option(min=0.001, metavar="HZ", help="How often.", show_default="1"),
    ] = None,
    once: Annotated[bool, typer.Option("--once", help="Publish one message and end.")] = False,
    count: CountOption = None,
    latch: Annotated[
        bool,
        typer.Option(
            "--latch", help="Late subscribers get the last message; with --once, stay until Ctrl-C."
        ),
    ] = False,
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Publish a message again and again, until Ctrl-C.

    With --once or -n it first waits up to 2 s for a subscriber. --json tells at the end what was sent.
    """
    from simple_ros import aio

    if once and (rate is not None or count is not None):
        raise typer.BadParameter("--once goes with neither --rate nor -n")
    period_s = 1.0 / (rate or 1.0)

    async def main() -> None:
        message = message_of(await _class_named(msg_type, master), text)
        turns = 1 if once else count
        await _pub(topic, message, period_s, turns, master, latch=latch, json=json)

    aio.run(main())


async def _class_named(spelling: str, master: str | None) -> type[Message]:
    """The class that is meant, known here or to the Master.

    Raises:
        UnknownMessageType: Known to neither.
    """
    from simple_ros.msg.registry import MsgFactory, resolve_type_name
    from simple_ros.net.master_client import MasterClient

    try:
        return MsgFactory.instance().get_class(resolve_type_name(spelling))
    except UnknownMessageType as error:
        async with MasterClient(master) as client:
            try:
                return await client.message_class(dotted(spelling))
            except UnknownMessageType:
                raise error from None


async def _pub(
    topic: str,
    message: Message,
    period_s: float,
    count: int | None,
    master: str | None,
    *,
    latch: bool,
    json: bool,
) -> None:
    from simple_ros.names import topic_name
    from simple_ros.net.master_client import MasterClient
    from simple_ros.qos import DEFAULT, LATCHED

    name = topic_name(topic)
    async with MasterClient(master) as client:
        await client.get_topics(name)  # a node would wait for its Master; here its absence is told
    async with cli_node("pub", master) as node:
        publisher = await node.advertise(name, type(message), qos=LATCHED if latch else DEFAULT)

        async def work() -> None:
            if count is not None and not latch:
                await _wait_for_subscriber(publisher)
            await _repeat(lambda: publisher.publish(message), period_s, count)
            if latch:
                await node.spin()
            await publisher.flush(_SUBSCRIBER_WAIT_S)

        try:
            await while_running(node, work())
        finally:
            if json:
                say(json_line(_statistics(publisher)))


def _statistics(publisher: Publisher[Any]) -> dict[str, Any]:
    found = publisher.statistics
    return {
        "topic": publisher.topic,
        "msg": publisher.msg_type,
        "published": found.published,
        "sent": found.sent,
        "dropped": found.dropped,
        "waiting": found.waiting,
    }


async def _wait_for_subscriber(publisher: Publisher[Any]) -> None:
    try:
        await publisher.wait_for_subscribers(1, _SUBSCRIBER_WAIT_S)
    except TimeoutError:
        print(
            f"warning: nobody has subscribed to {publisher.topic!r} within {_SUBSCRIBER_WAIT_S:g} s",
            file=sys.stderr,
        )


async def _repeat(act: Callable[[], None], period_s: float, count: int | None) -> None:
    """Act at once and then every period; turns that were missed are not made up for."""
    loop = asyncio.get_running_loop()
    due = loop.time()
    done = 0
    while True:
        act()
        done += 1
        if done == count:
            return
        due = max(due + period_s, loop.time())
        await asyncio.sleep(due - loop.time())
