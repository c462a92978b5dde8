"""``simple-ros topic``: what flows, how fast, and a way to publish by hand."""

from __future__ import annotations

import asyncio
import os
import sys
import time
from collections import deque
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Annotated, Any

import typer

from simple_ros.cli.output import (
    JsonOption,
    MasterOption,
    Style,
    StyleOption,
    UnknownName,
    bandwidth_facts,
    bandwidth_line,
    check_path,
    columns,
    cpp_text,
    delay_facts,
    delay_line,
    field_json,
    field_text,
    json_line,
    message_json,
    message_of,
    rate_facts,
    rate_line,
    say,
    split_path,
    stamp_path,
    yaml_text,
)
from simple_ros.errors import UnknownMessageType

if TYPE_CHECKING:
    from google.protobuf.message import Message

    from simple_ros.net.master_client import MasterClient
    from simple_ros.node import NodeHandle
    from simple_ros.publisher import Publisher
    from simple_ros.rpc import ros_rpc_pb2 as ros
    from simple_ros.subscriber import Subscriber

__all__ = ["app", "topics_of_type", "written_info", "written_list"]

app = typer.Typer(help="Look at topics, and publish on them.", no_args_is_help=True)

_SUBSCRIBER_WAIT_S = 2.0
_QUEUE_DEPTH = 1000

TopicArgument = Annotated[str, typer.Argument(metavar="TOPIC", help="Name of the topic.")]
WindowOption = Annotated[
    int, typer.Option("--window", min=2, help="Over how many messages it is computed.")
]


# -- list ------------------------------------------------------------------------------------------


@app.command("list")
def list_topics(
    filter: Annotated[  # noqa: A002
        str, typer.Argument(metavar="[FILTER]", help="Only names that contain this.")
    ] = "",
    json: JsonOption = False,
    style: StyleOption = Style.READABLE,
    master: MasterOption = None,
) -> None:
    """Print the topics and their types."""
    from simple_ros import aio

    async def main() -> None:
        async with aio.MasterClient(master) as client:
            topics = await client.get_topics(filter.lstrip("/"))
        if json:
            rows = sorted((topic.topic_name, topic.msg_type) for topic in topics)
            say(json_line([{"topic": name, "msg": msg_type} for name, msg_type in rows]))
        elif topics or style is Style.CPP:
            say(written_list(topics, style))

    aio.run(main())


def written_list(topics: list[ros.TopicInfo], style: Style) -> str:
    """Topics and types as text; the C++ style keeps the Master's order."""
    if style is Style.CPP:
        lines = [f" * {topic.topic_name} [{topic.msg_type}]" for topic in topics]
        return "\n".join(["Active topics:", *lines])
    return columns(sorted((topic.topic_name, topic.msg_type) for topic in topics))


# -- info ------------------------------------------------------------------------------------------


@app.command("info")
def info(
    topic: TopicArgument,
    json: JsonOption = False,
    style: StyleOption = Style.READABLE,
    master: MasterOption = None,
) -> None:
    """Print a topic's type, and who publishes and subscribes."""
    from simple_ros import aio

    async def main() -> None:
        async with aio.MasterClient(master) as client:
            name, found = await _found(client, topic)
        say(json_line(_info_json(name, found)) if json else written_info(name, found, style))

    aio.run(main())


async def _found(client: MasterClient, topic: str) -> tuple[str, ros.GetTopicInfoResponse]:
    """The Master's spelling of a topic and what it knows of it, whatever the leading slash.

    Raises:
        UnknownName: Nothing.
    """
    from simple_ros.names import canonical
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
    raise UnknownName("topic", topic, names)


def written_info(name: str, found: ros.GetTopicInfoResponse, style: Style) -> str:
    """A topic and its nodes as text."""
    return (_cpp_info if style is Style.CPP else _readable_info)(name, found)


def _readable_info(name: str, found: ros.GetTopicInfoResponse) -> str:
    lines = [f"Topic: {name}", f"Type: {found.msg_type}"]
    for title, nodes in (("Publishers", found.publishers), ("Subscribers", found.subscribers)):
        rows = sorted((f"  {node.node_name}", _address(node)) for node in nodes)
        lines += [f"{title}:", columns(rows)] if rows else [f"{title}: none"]
    return "\n".join(lines)


def _cpp_info(name: str, found: ros.GetTopicInfoResponse) -> str:
    lines = [f"Topic: {name}", f"Type: {found.msg_type}"]
    for title, nodes in (("Publishers", found.publishers), ("Subscribers", found.subscribers)):
        lines.append(f"{title}: {'' if nodes else 'None'}")
        lines += [f"  * {node.node_name} ({node.ip}:{node.port})" for node in nodes]
    return "\n".join(lines)


def _address(node: ros.NodeInfo) -> str:
    from simple_ros.net.addresses import join_address

    return join_address(node.ip, node.port)


def _info_json(name: str, found: ros.GetTopicInfoResponse) -> dict[str, Any]:
    def listed(nodes: Any) -> list[dict[str, Any]]:
        rows = sorted((node.node_name, node.ip, node.port) for node in nodes)
        return [{"name": name, "ip": ip, "port": port} for name, ip, port in rows]

    return {
        "topic": name,
        "msg": found.msg_type,
        "publishers": listed(found.publishers),
        "subscribers": listed(found.subscribers),
    }


# -- find ------------------------------------------------------------------------------------------


@app.command("find")
def find(
    msg_type: Annotated[str, typer.Argument(metavar="TYPE", help="Type, in any spelling.")],
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Print the topics that carry a type; nothing if there are none."""
    from simple_ros import aio

    async def main() -> None:
        async with aio.MasterClient(master) as client:
            topics = topics_of_type(await client.get_topics(), msg_type)
        if json:
            say(json_line(topics))
        elif topics:
            say("\n".join(topics))

    aio.run(main())


def topics_of_type(topics: list[ros.TopicInfo], spelling: str) -> list[str]:
    """Names of the topics that carry a type, which need not be known here if spelled in full.

    Raises:
        UnknownMessageType: No topic carries it, and nothing is known by that name.
    """
    from simple_ros.msg.registry import resolve_type_name

    names = (spelling, _dotted(spelling))
    foreign = sorted(topic.topic_name for topic in topics if topic.msg_type in names)
    if foreign:
        return foreign
    full_name = resolve_type_name(spelling)
    return sorted(topic.topic_name for topic in topics if topic.msg_type == full_name)


def _dotted(spelling: str) -> str:
    return spelling.replace("::", ".").replace("/", ".").replace(".msg.", ".").lstrip(".")


# -- following -------------------------------------------------------------------------------------


class _UnknownHere(UnknownMessageType):
    """A topic carries a type for which this program has no class."""

    def __init__(self, topic: str, error: UnknownMessageType) -> None:
        super().__init__(error.type_name, error.suggestions)
        self.args = (f"topic {topic!r} carries {error.type_name}, a type that is unknown here",)


@asynccontextmanager
async def _node(verb: str, master: str | None) -> AsyncIterator[NodeHandle]:
    """A node for one command; its name is taken by nobody else on this host."""
    from simple_ros.node import NodeHandle

    async with NodeHandle(f"cli_{verb}_{os.getpid()}", master=master) as node:
        yield node


async def _class_of(topic: str, master: str | None) -> tuple[str, type[Message]]:
    """The name under which to subscribe to a topic, and the class of its messages.

    Raises:
        UnknownName: The Master knows no such topic.
        UnknownMessageType: Its type is known neither here nor to the Master.
    """
    from simple_ros.net.master_client import MasterClient

    name, msg_type = await _type_of(topic, master)
    async with MasterClient(master) as client:
        try:
            return name, await client.message_class(msg_type)
        except UnknownMessageType as error:
            raise _UnknownHere(name, error) from None


async def _type_of(topic: str, master: str | None) -> tuple[str, str]:
    """The name under which to subscribe to a topic, and its type.

    Raises:
        UnknownName: The Master knows no such topic.
    """
    from simple_ros.names import topic_name
    from simple_ros.net.master_client import MasterClient

    name = topic_name(topic)
    async with MasterClient(master) as client:
        _, found = await _found(client, name)
    return name, found.msg_type


async def _subscribed(
    node: NodeHandle,
    topic: str,
    msg_type: str,
    callback: Callable[[bytes], None] | None = None,
) -> Subscriber[bytes]:
    """A subscription that every publisher can serve, as it requests nothing; for bytes."""
    from simple_ros.qos import QosProfile, Reliability

    qos = QosProfile(depth=_QUEUE_DEPTH, reliability=Reliability.BEST_EFFORT)
    return await node.subscribe(topic, msg_type, callback, qos=qos, raw=True)


# -- echo ------------------------------------------------------------------------------------------


@app.command("echo")
def echo(
    topic: TopicArgument,
    field: Annotated[
        str | None, typer.Option(metavar="A.B.C", help="Only this part of each message.")
    ] = None,
    once: Annotated[bool, typer.Option("--once", help="End after one message.")] = False,
    count: Annotated[
        int | None, typer.Option("-n", "--count", min=1, help="End after so many messages.")
    ] = None,
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

    name, message_class = await _class_of(topic, master)
    check_path(message_class.DESCRIPTOR, path)
    async with _node("echo", master) as node:
        left = count
        async for payload in await _subscribed(node, name, message_class.DESCRIPTOR.full_name):
            try:
                say(write(message_class.FromString(payload)))
            except (DecodeError, ValueError, IndexError) as error:
                print(f"warning: a message is left out: {error}", file=sys.stderr)
            if left is not None and (left := left - 1) == 0:
                return


# -- hz, bw, delay ---------------------------------------------------------------------------------


@app.command("hz")
def hz(
    topic: TopicArgument,
    window: WindowOption = 100,
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Print once a second how often messages arrive, until Ctrl-C."""
    from simple_ros import aio

    times: deque[float] = deque(maxlen=window)

    def report() -> str | None:
        facts = rate_facts(list(times))
        return _facts_text(facts, rate_line, json=json)

    def arrived(_: bytes) -> None:
        times.append(time.perf_counter())

    aio.run(_measure("hz", topic, master, arrived, report, json=json))


@app.command("bw")
def bw(
    topic: TopicArgument,
    window: WindowOption = 100,
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Print once a second how many bytes of messages arrive, until Ctrl-C."""
    from simple_ros import aio

    times: deque[float] = deque(maxlen=window)
    sizes: deque[int] = deque(maxlen=window)

    def report() -> str | None:
        facts = bandwidth_facts(list(times), list(sizes))
        return _facts_text(facts, bandwidth_line, json=json)

    def arrived(payload: bytes) -> None:
        times.append(time.perf_counter())
        sizes.append(len(payload))

    aio.run(_measure("bw", topic, master, arrived, report, json=json))


@app.command("delay")
def delay(
    topic: TopicArgument,
    window: WindowOption = 100,
    json: JsonOption = False,
    master: MasterOption = None,
) -> None:
    """Print once a second how old messages are by their stamp when they arrive, until Ctrl-C."""
    from simple_ros import aio

    delays: deque[float] = deque(maxlen=window)

    def report() -> str | None:
        facts = delay_facts(list(delays))
        return _facts_text(facts, delay_line, json=json)

    async def main() -> None:
        name, message_class = await _class_of(topic, master)
        path = stamp_path(message_class.DESCRIPTOR)

        def arrived(payload: bytes) -> None:
            now_ns = time.time_ns()
            stamp: Any = message_class.FromString(payload)
            for part in path:
                stamp = getattr(stamp, part)
            stamp_ns = stamp.seconds * 10**9 + stamp.nanos
            if stamp_ns:  # else nobody has stamped it
                delays.append((now_ns - stamp_ns) / 1e9)

        await _measure("delay", name, master, arrived, report, json=json)

    aio.run(main())


def _facts_text(
    facts: dict[str, Any] | None, line: Callable[[dict[str, Any]], str], *, json: bool
) -> str | None:
    if facts is None:
        return None
    return json_line(facts) if json else line(facts)


async def _measure(
    verb: str,
    topic: str,
    master: str | None,
    arrived: Callable[[bytes], None],
    report: Callable[[], str | None],
    *,
    json: bool,
) -> None:
    """Subscribe and report once a second, also that nothing came."""
    name, msg_type = await _type_of(topic, master)
    async with _node(verb, master) as node:
        subscriber = await _subscribed(node, name, msg_type, arrived)
        seen = 0
        while True:
            await asyncio.sleep(1.0)
            received = subscriber.statistics.received
            line = report()
            if received == seen:
                line = None if json else "no new messages"
            elif line is None and not json:
                line = "not enough messages yet"
            seen = received
            if line is not None:
                say(line)


# -- pub -------------------------------------------------------------------------------------------


@app.command("pub")
def pub(
    topic: TopicArgument,
    msg_type: Annotated[str, typer.Argument(metavar="TYPE", help="Type, in any spelling.")],
    text: Annotated[
        str, typer.Argument(metavar="YAML", help="The message, as YAML or JSON.")
    ] = "{}",
    rate: Annotated[
        float | None,
        typer.Option(min=0.001, metavar="HZ", help="How often.", show_default="1"),
    ] = None,
    once: Annotated[bool, typer.Option("--once", help="Publish one message and end.")] = False,
    count: Annotated[
        int | None, typer.Option("-n", "--count", min=1, help="End after so many messages.")
    ] = None,
    latch: Annotated[
        bool,
        typer.Option(
            "--latch", help="Late subscribers get the last message; with --once, stay until Ctrl-C."
        ),
    ] = False,
    master: MasterOption = None,
) -> None:
    """Publish a message again and again, until Ctrl-C.

    With --once or -n it first waits up to 2 s for a subscriber.
    """
    from simple_ros import aio

    if once and (rate is not None or count is not None):
        raise typer.BadParameter("--once goes with neither --rate nor -n")
    period_s = 1.0 / (rate or 1.0)

    async def main() -> None:
        message = message_of(await _class_named(msg_type, master), text)
        await _pub(topic, message, period_s, 1 if once else count, master, latch=latch)

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
                return await client.message_class(_dotted(spelling))
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
) -> None:
    from simple_ros.names import topic_name
    from simple_ros.net.master_client import MasterClient
    from simple_ros.qos import DEFAULT, LATCHED

    name = topic_name(topic)
    async with MasterClient(master) as client:
        await client.get_topics(name)  # a node would wait for its Master; here its absence is told
    async with _node("pub", master) as node:
        publisher = await node.advertise(name, type(message), qos=LATCHED if latch else DEFAULT)
        if count is not None and not latch:
            await _wait_for_subscriber(publisher)
        await _repeat(lambda: publisher.publish(message), period_s, count)
        if latch:
            await node.spin()
        await publisher.flush(_SUBSCRIBER_WAIT_S)


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
