"""``simple-ros topic delay``."""

from __future__ import annotations

import asyncio
import math
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer

from simple_ros.cli.delays import Way, delay_facts, delay_line
from simple_ros.cli.hosts import connect, is_this_host
from simple_ros.cli.lookup import UnknownName, address_text, find_topic
from simple_ros.cli.message_fields import stamp_path
from simple_ros.cli.options import JsonOption, MasterOption, TopicArgument, WindowOption
from simple_ros.cli.text import json_line, say
from simple_ros.cli.topic.following import class_of, cli_node, subscribe_bytes, while_running
from simple_ros.cli.topic.quantities import NOTHING_NEW
from simple_ros.errors import MasterUnavailable

if TYPE_CHECKING:
    from google.protobuf.message import Message

    from simple_ros.rpc import ros_rpc_pb2 as ros

__all__ = ["delay", "parse_offset", "way_from"]

_REPORT_S = 1.0
_LOOK_AGAIN_S = 5.0
_CONNECTIONS = 5
_UNSTAMPED = "no message with a stamp yet"


def parse_offset(text: str) -> float | str:
    """``none``, ``auto`` or seconds.

    Raises:
        typer.BadParameter: It is none of these.
    """
    if text in ("none", "auto"):
        return text
    try:
        offset = float(text)
    except ValueError:
        offset = math.nan
    if not math.isfinite(offset):
        raise typer.BadParameter(f"{text!r} is neither 'none' nor 'auto' nor a number of seconds")
    return offset


def delay(
    topic: TopicArgument,
    window: WindowOption = 100,
    offset: Annotated[
        str,
        typer.Option(
            metavar="none|auto|SECONDS",
            help="Subtract how far this host's clock is ahead of the publisher's: nothing, an "
            "estimate, or so many seconds.",
        ),
    ] = "none",
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Print once a second how old messages are by their stamp when they arrive, until Ctrl-C.

    A second line tells when that cannot be, since the clocks of two hosts differ.
    """
    from simple_ros import aio

    aio.run(_measure(topic, window, parse_offset(offset), master, json=json))


async def _measure(
    topic: str, length: int, offset: float | str, master: str | None, *, json: bool
) -> None:
    name, message_class = await class_of(topic, master)
    stamp_of = _stamp_reader(message_class)
    delays: deque[float] = deque(maxlen=length)
    survey = _Survey(name, master)
    fresh = False

    def arrived(payload: bytes) -> None:
        nonlocal fresh
        now_ns = time.time_ns()
        stamp_ns = stamp_of(payload)
        fresh = True
        if stamp_ns:  # else nobody has stamped it
            delays.append((now_ns - stamp_ns) / 1e9)

    async def report() -> None:
        nonlocal fresh
        while True:
            await asyncio.sleep(_REPORT_S)
            facts = delay_facts(list(delays), survey.way, offset) if fresh else None
            if json and facts is not None:
                say(json_line({"topic": name} | facts))
            elif not json:
                say(_text(facts, survey.way, fresh))
            fresh = False

    await survey.look()
    if offset == "auto" and survey.way.problem:
        print(f"warning: no offset can be estimated: {survey.way.problem}", file=sys.stderr)
    async with cli_node("delay", master) as node:
        await subscribe_bytes(node, name, message_class.DESCRIPTOR.full_name, arrived)
        surveying = asyncio.create_task(survey.look_again())
        try:
            await while_running(node, report())
        finally:
            surveying.cancel()
            await asyncio.wait([surveying])


def _text(facts: dict[str, Any] | None, way: Way, fresh: bool) -> str:
    if not fresh:
        return NOTHING_NEW
    return _UNSTAMPED if facts is None else delay_line(facts, way.problem)


def _stamp_reader(message_class: type[Message]) -> Callable[[bytes], int]:
    """What gives the stamp of a serialised message in nanoseconds, 0 if it has none."""
    path = stamp_path(message_class.DESCRIPTOR)

    def read(payload: bytes) -> int:
        stamp: Any = message_class.FromString(payload)
        for part in path:
            stamp = getattr(stamp, part)
        return int(stamp.seconds * 10**9 + stamp.nanos)

    return read


class _Survey:
    """Keeps looking where the publishers of a topic are, and how far away.

    Attributes:
        way: What was found last.
    """

    def __init__(self, topic: str, master: str | None) -> None:
        self.way = Way(problem="nobody has looked yet")
        self._topic = topic
        self._master = master

    async def look_again(self) -> None:
        """Look every few seconds."""
        while True:
            await asyncio.sleep(_LOOK_AGAIN_S)
            try:
                await self.look()
            except (MasterUnavailable, UnknownName):
                continue  # what was found last is the best there is

    async def look(self) -> None:
        """Look once.

        Raises:
            UnknownName: The topic has gone.
            MasterUnavailable: Nobody answers.
        """
        from simple_ros.net.master_client import MasterClient

        async with MasterClient(self._master) as client:
            _, found = await find_topic(client, self._topic)
        self.way = await way_from(found.publishers, self._master)


async def way_from(publishers: Sequence[ros.NodeInfo], master: str | None) -> Way:
    """Where these publishers are, and the shortest of some round trips to them."""
    if not publishers:
        return Way(problem="nobody publishes")
    hosts = {node.ip: node for node in publishers}
    local = {ip for ip in hosts if await asyncio.to_thread(is_this_host, ip, master)}
    if len(local) == len(hosts):
        return Way(is_local=True)
    if len(hosts) - len(local) + bool(local) > 1:
        return Way(problem="publishers are on several hosts")
    (node,) = hosts.values()
    attempts = [await connect(node.ip, node.port) for _ in range(_CONNECTIONS)]
    times = [taken_ms for taken_ms, _ in attempts if taken_ms is not None]
    if times:
        return Way(round_trip_s=min(times) / 1e3)
    return Way(problem=f"{attempts[0][1]} at {address_text(node)}")
