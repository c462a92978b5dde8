"""``simple-ros foxglove``."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import AsyncIterator
from contextlib import ExitStack, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from socket import gethostname
from typing import TYPE_CHECKING, Annotated
from urllib.parse import quote

import typer

from simple_ros.cli.bag.arguments import bag_files, counted, size_of
from simple_ros.cli.options import MasterOption
from simple_ros.cli.text import json_line, say

if TYPE_CHECKING:
    import ssl

    from simple_ros.foxglove.bridge import BridgeOptions
    from simple_ros.foxglove.playback import PlaybackOptions
    from simple_ros.foxglove.server import FoxgloveServer, ServerOptions

__all__ = ["command"]

_APP = "https://app.foxglove.dev/~/view?ds=foxglove-websocket&ds.url="
_STATS_S = 1.0


@dataclass(frozen=True)
class _Where:
    host: str
    port: int
    tls: ssl.SSLContext | None
    record: Path | None
    stats: bool

    @property
    def is_local(self) -> bool:
        """Whether only programs of this host can connect."""
        return self.host in ("localhost", "::1") or self.host.startswith("127.")

    @property
    def scheme(self) -> str:
        return "ws" if self.tls is None else "wss"


def command(
    host: Annotated[str, typer.Option(help="Address to listen on; 0.0.0.0 for all.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="0 takes any free one.")] = 8765,
    topics: Annotated[
        str | None,
        typer.Option(metavar="REGEX", help="Only topics that fit, also those clients publish."),
    ] = None,
    exclude: Annotated[
        str | None, typer.Option(metavar="REGEX", help="But not topics that fit this.")
    ] = None,
    client_topics: Annotated[
        str | None,
        typer.Option(metavar="REGEX", help="Clients publish only topics that fit."),
    ] = None,
    services: Annotated[
        str | None, typer.Option(metavar="REGEX", help="Only services that fit.")
    ] = None,
    parameters: Annotated[
        str | None, typer.Option(metavar="REGEX", help="Only parameters that fit.")
    ] = None,
    without: Annotated[
        list[str] | None,
        typer.Option(metavar="CAPABILITY", help="Do not offer services, say, or clientPublish."),
    ] = None,
    read_only: Annotated[
        bool, typer.Option("--read-only", help="Clients change nothing: they only look.")
    ] = False,
    tls_cert: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Certificate (PEM), for wss://.")
    ] = None,
    tls_key: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Its key, if it is not in the same file.")
    ] = None,
    token: Annotated[
        str | None,
        typer.Option(
            envvar="SIMPLE_ROS_FOXGLOVE_TOKEN", help="What clients must know: ws://...?token=TOKEN."
        ),
    ] = None,
    allow_origin: Annotated[
        list[str] | None,
        typer.Option(metavar="ORIGIN", help="Let pages of this origin connect; '*' for all."),
    ] = None,
    max_rate: Annotated[
        list[str] | None,
        typer.Option(metavar="TOPIC=HZ", help="Send no more messages a second; * and ? fit names."),
    ] = None,
    queue: Annotated[
        list[str] | None,
        typer.Option(metavar="TOPIC=N", help="Only the newest N messages wait for a slow client."),
    ] = None,
    send_buffer_limit: Annotated[
        str, typer.Option(metavar="SIZE", help="How much may wait for each client.")
    ] = "16MiB",
    compress: Annotated[
        bool, typer.Option("--compress", help="For slow links; it costs much computing.")
    ] = False,
    asset_root: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=DIR", help="Serve package://NAME/... from this directory."),
    ] = None,
    assets: Annotated[
        str | None, typer.Option(metavar="REGEX", help="Serve only files whose URI fits.")
    ] = None,
    frame: Annotated[
        str, typer.Option(metavar="FRAME", help="The frame of messages that name none.")
    ] = "world",
    service_timeout: Annotated[
        float, typer.Option(metavar="S", min=0.001, help="After this a call has failed.")
    ] = 60.0,
    stats: Annotated[
        bool, typer.Option("--stats", help="Print each client's counters every second, as JSON.")
    ] = False,
    record: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Record what clients see into an MCAP file."),
    ] = None,
    bag: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE", help="Show this bag, with playback control; needs no Master."),
    ] = None,
    rate: Annotated[
        float, typer.Option("-r", "--rate", min=0.001, help="Of --bag: twice as fast is 2.")
    ] = 1.0,
    loop: Annotated[bool, typer.Option("-l", "--loop", help="Of --bag: over and over.")] = False,
    paused: Annotated[
        bool, typer.Option("-p", "--start-paused", help="Of --bag: until a client plays it.")
    ] = False,
    master: MasterOption = None,
) -> None:
    """Show everything live in Foxglove, Lichtblick and other apps that speak their protocol.

    Open the printed link, or choose "Foxglove WebSocket" in the app. Runs until Ctrl-C.
    """
    from importlib.metadata import version

    from simple_ros import aio
    from simple_ros.foxglove.access import Access
    from simple_ros.foxglove.assets import AssetRoots
    from simple_ros.foxglove.bridge import BridgeOptions
    from simple_ros.foxglove.playback import PlaybackOptions
    from simple_ros.foxglove.rates import TopicLimits
    from simple_ros.foxglove.server import ServerOptions, tls_context

    if bag is None and (loop or paused or rate != 1.0):
        raise typer.BadParameter("--rate, --loop and --start-paused are for --bag")
    if token == "":
        raise typer.BadParameter("--token is empty; leave it away to let everybody in")
    if not frame.strip("/"):
        raise typer.BadParameter("--frame wants the name of a frame")
    server = ServerOptions(
        access=Access.made(
            topics,
            exclude,
            client_topics=client_topics,
            services=services,
            parameters=parameters,
            without=without or (),
            read_only=read_only,
            token=token,
            origins=allow_origin or (),
        ),
        buffer_bytes=size_of(send_buffer_limit),
        rates=TopicLimits.made(max_rate or (), "--max-rate"),
        depths=TopicLimits.made(queue or (), "--queue", whole=True),
        metadata={"simple_ros": version("simple-ros")},
        frame_id=frame.removeprefix("/"),
        compress=compress,
    )
    tls = None if tls_cert is None else tls_context(tls_cert, tls_key)
    if tls_cert is None and tls_key is not None:
        raise typer.BadParameter("--tls-key needs --tls-cert")
    where = _Where(host, port, tls, record, stats)
    if bag is not None:
        files = bag_files(bag)
        aio.run(_play(files, server, PlaybackOptions(rate, loop, paused), where))
    else:
        options = BridgeOptions(server, AssetRoots.made(asset_root or (), assets), service_timeout)
        aio.run(_bridge(options, where, master))


async def _bridge(options: BridgeOptions, where: _Where, master: str | None) -> None:
    from simple_ros.cli.topic.following import while_running
    from simple_ros.foxglove.bridge import Bridge
    from simple_ros.node import NodeHandle

    async with NodeHandle(_own_name(), master=master) as node:
        bridge = Bridge(node, options)
        async with _serving(bridge.server, where):
            await while_running(node, bridge.run())


def _own_name() -> str:
    """A node's name that no other bridge has, on this host or another: it would end that one."""
    host = "".join(char if char.isascii() and char.isalnum() else "_" for char in gethostname())
    return f"foxglove_bridge_{host}_{os.getpid()}"


async def _play(
    files: list[Path], server: ServerOptions, options: PlaybackOptions, where: _Where
) -> None:
    from simple_ros.bag import Bag
    from simple_ros.foxglove.playback import BagPlayback

    with ExitStack() as stack:
        bags = [stack.enter_context(Bag(path)) for path in files]
        playback = BagPlayback(bags, server, options)
        for topic, reason in playback.skipped.items():
            if not server.access.wants(topic):
                continue  # just what was asked for
            print(f"warning: {topic!r} is not shown: {reason}", file=sys.stderr)
        async with _serving(playback.server, where):
            await playback.run()


@asynccontextmanager
async def _serving(server: FoxgloveServer, where: _Where) -> AsyncIterator[None]:
    """Listen meanwhile, record and print what is asked for."""
    from simple_ros.foxglove.recording import Recording
    from simple_ros.foxglove.reporting import publish_statistics
    from simple_ros.ready import ready

    recording = None if where.record is None else Recording(where.record)
    server.tap(recording)
    try:
        async with server.listening(where.host, where.port, where.tls):
            _say_where(server, where)
            ready()
            tasks = [asyncio.create_task(publish_statistics(server))]
            if where.stats:
                tasks.append(asyncio.create_task(_print_statistics(server)))
            try:
                yield
            finally:
                for task in tasks:
                    task.cancel()
                await asyncio.gather(*tasks, return_exceptions=True)
    finally:
        if recording is not None:
            count = await recording.finish()
            say(f"wrote {where.record}: {counted(count)}")


def _say_where(server: FoxgloveServer, where: _Where) -> None:
    url = f"{where.scheme}://{_reachable(where.host)}:{server.port}"
    say(f"listening at {url}")
    access = server.options.access
    if access.token is None:
        say(f"open {_APP}{quote(url, safe='')}")
        if not where.is_local:
            may = "look" if access.read_only else "look, publish, call services and set parameters"
            print(f"warning: without --token, whoever reaches this host may {may}", file=sys.stderr)
    else:
        say(f"clients connect to {url}/?token=TOKEN")


def _reachable(host: str) -> str:
    """A name under which this host can reach an address it listens on."""
    if host in ("127.0.0.1", "0.0.0.0", "", "::", "::1"):
        return "localhost"
    return f"[{host}]" if ":" in host else host


async def _print_statistics(server: FoxgloveServer) -> None:
    from simple_ros.foxglove.reporting import statistics_dict, topics_of

    while True:
        await asyncio.sleep(_STATS_S)
        topics = topics_of(server)
        for item in server.statistics:
            say(json_line(statistics_dict(item, topics)))
