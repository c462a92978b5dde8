"""``simple-ros link``: simulated radio between real nodes."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import sys
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
import yaml

from simple_ros import aio
from simple_ros.errors import ConfigError, ServiceUnavailable
from simple_ros.ready import ready

if TYPE_CHECKING:
    from simple_ros.msg.link_shaper_msgs import ClassStatistics, ShaperStatistics
    from simple_ros_engines.simulator.shaper_settings import ShaperSettings

__all__ = ["app"]

app = typer.Typer(
    help="Simulated radio between real nodes (no radio is behind it).",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)

MasterOption = Annotated[str | None, typer.Option(metavar="HOST:PORT", help="Where the Master is.")]


@app.command()
def shape(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Links and classes, YAML.")],
    listen: Annotated[
        str | None, typer.Option(metavar="HOST:PORT", help="Instead of the file's; port 0: any.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Instead of the file's.")] = None,
    node: Annotated[
        bool, typer.Option(help="Be a node too: statistics, and changes while it runs.")
    ] = True,
    master: MasterOption = None,
) -> None:
    """Carry messages between sites as simulated radio would, until Ctrl-C.

    Nodes come by the transport 'shaped': SIMPLE_ROS_TRANSPORTS=local,shaped SIMPLE_ROS_SITE=robot.
    """
    logging.basicConfig(stream=sys.stderr, level=logging.INFO, format="%(levelname)s %(message)s")
    settings = read_file(file)
    if listen is not None:
        settings = replace(settings, listen=listen)
    if seed is not None:
        settings = replace(settings, seed=seed)
    aio.run(_shape(settings, master if node else None, with_node=node))


def read_file(file: Path) -> ShaperSettings:
    """Settings of a file; traces it names are read too.

    Raises:
        ConfigError: It cannot be read, or makes no sense.
    """
    from simple_ros_engines.simulator.shaper_reading import read_settings

    try:
        data = yaml.safe_load(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{file}: {error.strerror}") from None
    except (UnicodeDecodeError, yaml.YAMLError) as error:
        raise ConfigError(f"{file}: {' '.join(str(error).split())}") from None
    if isinstance(data, dict) and isinstance(data.get("links"), dict):
        for link in data["links"].values():
            _read_trace(link, file.parent)
    return read_settings(data, str(file))


def _read_trace(link: Any, folder: Path) -> None:
    """Put the text of a trace where its file's name stands."""
    channel = link.get("channel") if isinstance(link, dict) else None
    if isinstance(channel, dict) and "file" in channel:
        path = folder / str(channel.pop("file"))
        try:
            channel["text"] = path.read_text(encoding="utf-8")
        except OSError as error:
            raise ConfigError(f"{path}: {error.strerror}") from None
        except UnicodeDecodeError as error:
            raise ConfigError(f"{path}: {error}") from None


async def _shape(settings: ShaperSettings, master: str | None, *, with_node: bool) -> None:
    from simple_ros_engines.link_shaper.relay import Relay

    try:
        relay = Relay(settings)
    except OSError as error:
        raise ConfigError(f"cannot listen on {settings.listen}: {error.strerror}") from None
    async with relay:
        print(f"link shaper (simulated): listening on {relay.address}", flush=True)
        ready()
        if with_node:
            await _be_a_node(relay, master)
        else:
            await asyncio.get_running_loop().create_future()


async def _be_a_node(relay: Any, master: str | None) -> None:
    from simple_ros_engines.link_shaper.node import NODE, ShaperNode
    from simple_ros_engines.link_shaper.transport import OBSERVER, ShapedTransport

    # It looks on: robots reach it, and it them, but not over their radio.
    ways = ("local", ShapedTransport(OBSERVER, relay.address), "unix", "tcp")
    async with aio.NodeHandle(NODE, master=master, transports=ways) as node:
        await ShaperNode(relay).run(node)


@app.command("set")
def set_link(
    link: Annotated[str, typer.Argument(help="Site of the link.")],
    changes: Annotated[
        list[str],
        typer.Argument(
            metavar="NAME=VALUE...",
            help="rate_mbps, delay_ms, jitter_ms, loss, min_share, max_share.",
        ),
    ],
    way: Annotated[str, typer.Option(metavar="up|down", help="Only this direction.")] = "",
    master: MasterOption = None,
) -> None:
    """Change a link of the running shaper."""
    wanted: dict[str, float] = {}
    for change in changes:
        name, _, value = change.partition("=")
        try:
            wanted[name] = float(value)
        except ValueError:
            raise ConfigError(f"{change!r}: write NAME=VALUE with a number") from None
    refused = aio.run(_set(link, way, wanted, master))
    if refused:
        raise ConfigError(refused)


async def _set(link: str, way: str, changes: dict[str, float], master: str | None) -> str:
    from simple_ros.msg.link_shaper_msgs import SetLink, SetLinkRequest
    from simple_ros_engines.link_shaper.node import NODE

    async with _calling(f"/{NODE}/set_link", SetLink, master) as client:
        answer = await client.call(SetLinkRequest(link=link, direction=way, changes=changes))
        return "" if answer.ok else answer.message


@app.command()
def stats(
    as_json: Annotated[bool, typer.Option("--json", help="For programs.")] = False,
    master: MasterOption = None,
) -> None:
    """Print what became of the messages of each link and class."""
    found = aio.run(_stats(master))
    if found is None:
        raise typer.Exit(130)
    if as_json:
        from google.protobuf.json_format import MessageToJson

        with contextlib.suppress(BrokenPipeError):
            print(MessageToJson(found, preserving_proto_field_name=True))
        return
    print(_table(found))


async def _stats(master: str | None) -> ShaperStatistics:
    from simple_ros.msg.link_shaper_msgs import GetStatistics, GetStatisticsRequest
    from simple_ros_engines.link_shaper.node import NODE

    async with _calling(f"/{NODE}/get_statistics", GetStatistics, master) as client:
        found: ShaperStatistics = (await client.call(GetStatisticsRequest())).statistics
        return found


@contextlib.asynccontextmanager
async def _calling(service: str, kind: Any, master: str | None) -> AsyncIterator[Any]:
    """A client of the running shaper."""
    try:
        # Services go round the shaper; so this works where SIMPLE_ROS_TRANSPORTS says shaped, too.
        ways = ("local", "unix", "tcp")
        async with aio.NodeHandle(
            f"cli_link_{os.getpid()}", master=master, transports=ways
        ) as node:
            yield node.service_client(service, kind, timeout=5.0)
    except ServiceUnavailable:
        raise ConfigError(
            "no link shaper runs here; start it: simple-ros link shape FILE"
        ) from None


def _table(found: ShaperStatistics) -> str:
    lines = []
    for link in found.links:
        radio = f", {link.snr_db:.1f} dB" if link.has_radio else ""
        lines.append(
            f"{link.link} {link.direction}: {link.rate_bps / 1e6:.3g} Mbit/s, share "
            f"{link.min_share:.2g} to {link.max_share:.2g}, delay {link.delay_ms:g} ms{radio}"
        )
        lines += [_class_line(item) for item in link.classes if item.offered]
    return "\n".join(lines)


def _class_line(item: ClassStatistics) -> str:
    return (
        f"  {item.name:<12} {item.offered} offered, {item.delivered} delivered, {item.late} late, "
        f"{item.dropped} dropped, {item.lost} lost, {item.expired} expired; "
        f"latency p50 {item.latency_p50_ms:.1f}, p99 {item.latency_p99_ms:.1f} ms"
    )
