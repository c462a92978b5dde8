"""``simple-ros service call``."""

from __future__ import annotations

import asyncio
import sys
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any

import typer

from simple_ros.cli.message_input import message_of
from simple_ros.cli.message_text import message_json, yaml_text
from simple_ros.cli.node.pinging import ping_summary
from simple_ros.cli.options import CountOption, JsonOption, MasterOption
from simple_ros.cli.service.lookup import ServiceArgument, find_service
from simple_ros.cli.text import json_line, one_line, say
from simple_ros.cli.topic.following import cli_node, while_running
from simple_ros.errors import ServiceCallError

if TYPE_CHECKING:
    from google.protobuf.message import Message

    from simple_ros.msg.interfaces import ServiceType
    from simple_ros.service_client import ServiceClient

__all__ = ["call"]

_INTERRUPTED = 130
"""Exit code after Ctrl-C where not everything asked for was done, as shells have it."""


def call(
    service: ServiceArgument,
    text: Annotated[
        str, typer.Argument(metavar="YAML", help="The request, as YAML or JSON.")
    ] = "{}",
    timeout: Annotated[
        float | None,
        typer.Option(min=0.001, metavar="S", help="Give up after so long.", show_default="never"),
    ] = None,
    priority: Annotated[
        int, typer.Option(min=0, max=255, help="Higher goes first where calls wait.")
    ] = 0,
    count: CountOption = None,
    rate: Annotated[
        float | None,
        typer.Option(
            min=0.001,
            metavar="HZ",
            help="Call again and again, so often.",
            show_default="with -n: each when the one before is answered",
        ),
    ] = None,
    show_time: Annotated[
        bool, typer.Option("--time", help="Also how long each took, in milliseconds.")
    ] = False,
    full: Annotated[bool, typer.Option("--full", help="Cut no long lists and bytes.")] = False,
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Call a service and print what it answers; its type need not be known here.

    Code 1: a call was not answered, or its handler failed; 130: ended before all of -n were made.
    """
    from simple_ros import aio

    turns = count if count is not None or rate is not None else 1
    calls = _Calls(timeout, priority, show_time=show_time, full=full, json=json)

    async def main() -> None:
        kind, request = await _prepared(service, text, master)
        async with cli_node("call", master) as node:
            client = node.service_client(f"/{service.lstrip('/')}", kind)
            await while_running(node, calls.make(client, request, turns, rate))

    aio.run(main())
    if show_time and not json and len(calls.times_ms) > 1:
        say(f"# {ping_summary(calls.times_ms)}")
    if None in calls.times_ms:
        raise typer.Exit(1)
    if turns is not None and len(calls.times_ms) < turns:
        raise typer.Exit(_INTERRUPTED)


async def _prepared(
    service: str, text: str, master: str | None
) -> tuple[ServiceType[Any, Any], Message]:
    """The type of a service, and the request that a text describes.

    Raises:
        UnknownName: The Master knows no such service.
        UnknownMessageType: A message of its type is known neither here nor to the Master.
        BadMessageText: The text does not describe a request.
    """
    from simple_ros.msg.interfaces import ServiceType
    from simple_ros.net.master_client import MasterClient

    async with MasterClient(master) as client:
        info = await find_service(client, service)
        request_class = await client.message_class(info.request_type)
        response_class = await client.message_class(info.response_type)
    return ServiceType(request_class, response_class), message_of(request_class, text)


@dataclass
class _Calls:
    """Makes calls and prints their answers.

    Attributes:
        times_ms: How long each took; None for those that failed.
    """

    timeout_s: float | None
    priority: int
    show_time: bool
    full: bool
    json: bool
    times_ms: list[float | None] = field(default_factory=list)

    async def make(
        self,
        client: ServiceClient[Any, Any],
        request: Message,
        turns: int | None,
        rate: float | None,
    ) -> None:
        """Call so many times, or until cancelled; what cannot be made in time is not made up for."""
        loop = asyncio.get_running_loop()
        due = loop.time()
        while turns is None or len(self.times_ms) < turns:
            if rate is not None and self.times_ms:
                due = max(due + 1.0 / rate, loop.time())
                await asyncio.sleep(due - loop.time())
            await self._once(client, request, several=turns != 1)

    async def _once(
        self, client: ServiceClient[Any, Any], request: Message, *, several: bool
    ) -> None:
        begun = time.perf_counter()
        try:
            response = await client.call(request, timeout=self.timeout_s, priority=self.priority)
        except ServiceCallError as error:
            self.times_ms.append(None)
            print(f"error: {one_line(str(error))}", file=sys.stderr, flush=True)
            return
        taken_ms = 1e3 * (time.perf_counter() - begun)
        self.times_ms.append(taken_ms)
        try:
            say(
                self._json(response, taken_ms)
                if self.json
                else self._text(response, taken_ms, several=several)
            )
        except ValueError as error:
            print(f"warning: an answer is left out: {error}", file=sys.stderr)

    def _text(self, response: Message, taken_ms: float, *, several: bool) -> str:
        lines = [yaml_text(response, full=self.full)]
        if self.show_time:
            lines.append(f"# {taken_ms:.3f} ms")
        if several:
            lines.append("---")
        return "\n".join(lines)

    def _json(self, response: Message, taken_ms: float) -> str:
        value = message_json(response)
        return json_line({"response": value, "ms": taken_ms} if self.show_time else value)
