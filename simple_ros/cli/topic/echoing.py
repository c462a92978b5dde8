"""``simple-ros topic echo``."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated

import typer

from simple_ros.cli.message_cpp import cpp_text
from simple_ros.cli.message_fields import check_path, split_path
from simple_ros.cli.message_text import field_json, field_text, message_json, yaml_text
from simple_ros.cli.options import (
    CountOption,
    JsonOption,
    MasterOption,
    Style,
    StyleOption,
    TopicArgument,
)
from simple_ros.cli.text import json_line, say
from simple_ros.cli.topic.following import class_of, cli_node, subscribe_bytes

if TYPE_CHECKING:
    from google.protobuf.message import Message

__all__ = ["echo"]


def echo(
    topic: TopicArgument,
    field: Annotated[
        str | None, typer.Option(metavar="A.B.C", help="Only this part of each message.")
    ] = None,
    once: Annotated[bool, typer.Option("--once", help="End after one message.")] = False,
    count: CountOption = None,
    full: Annotated[
        bool, typer.Option("--full", help="Cut no long list and no long bytes.")
    ] = False,
    json: JsonOption = False,
    style: StyleOption = Style.READABLE,
    master: MasterOption = None,
) -> None:
    """Print the messages of a topic, until Ctrl-C."""
    from simple_ros import aio

    if style is Style.CPP and (json or field is not None):
        raise typer.BadParameter("--format cpp goes with neither --json nor --field")
    path = split_path(field) if field is not None else ()
    aio.run(_echo(topic, master, 1 if once else count, path, _writer(path, json, style, full)))


def _writer(
    path: tuple[str, ...], json: bool, style: Style, full: bool
) -> Callable[[Message], str]:
    """How one message is written, with what stands between it and the next."""
    if json and path:
        return lambda message: json_line(field_json(message, path))
    if json:
        return lambda message: json_line(message_json(message))
    if style is Style.CPP:
        return cpp_text
    if path:
        return lambda message: field_text(message, path, full=full) + "\n---"
    return lambda message: yaml_text(message, full=full) + "\n---"


async def _echo(
    topic: str,
    master: str | None,
    count: int | None,
    path: tuple[str, ...],
    write: Callable[[Message], str],
) -> None:
    from google.protobuf.message import DecodeError

    name, message_class = await class_of(topic, master)
    check_path(message_class.DESCRIPTOR, path)
    async with cli_node("echo", master) as node:
        left = count
        async for payload in await subscribe_bytes(node, name, message_class.DESCRIPTOR.full_name):
            try:
                say(write(message_class.FromString(payload)))
            except (DecodeError, ValueError, IndexError) as error:
                print(f"warning: a message is left out: {error}", file=sys.stderr)
            if left is not None and (left := left - 1) == 0:
                return
