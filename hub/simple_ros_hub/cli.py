"""The command ``simple-ros-hub``."""

from __future__ import annotations

import asyncio
import logging
import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer
import yaml

from simple_ros import aio, plugins
from simple_ros.errors import ConfigError, SimpleRosError
from simple_ros.net.addresses import address_of
from simple_ros.ready import ready
from simple_ros_hub.components import (
    RESPAWN,
    Component,
    check_components,
    components_of,
    default_components,
    with_parameters,
)
from simple_ros_hub.hub import NODE_NAME, Hub
from simple_ros_hub.keeper import ProcessKeeper
from simple_ros_hub.memory import Memory
from simple_ros_hub.place import HubRuns, Place, directory_for
from simple_ros_hub.runner import CELLS

__all__ = ["command"]

PROGRAM = "simple-ros-hub"
_LOOK_EVERY_S = 0.2


def command(
    config: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            dir_okay=False,
            help="Components, in YAML; otherwise the three engines and the cells named by --cell.",
        ),
    ] = None,
    cell: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME[,NAME]...", help="Cells to run, too; may be given several times."
        ),
    ] = None,
    parameter: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="COMPONENT.PARAMETER=VALUE",
            help="Parameter of a component; may be given several times.",
        ),
    ] = None,
    master: Annotated[
        str | None, typer.Option(metavar="HOST:PORT", help="Where the Master is.")
    ] = None,
    restarts: Annotated[
        int, typer.Option(min=0, help="Restarts within a minute before one is given up.")
    ] = 5,
    dashboard: Annotated[
        str, typer.Option(metavar="[HOST:]PORT", help="Where the live page is; empty for none.")
    ] = "",
    standby: Annotated[
        bool, typer.Option("--standby", help="If a hub runs, wait and take over from it.")
    ] = False,
    leave_running: Annotated[
        bool, typer.Option("--leave-running", help="Engines and cells run on after the hub.")
    ] = False,
    end: Annotated[
        bool, typer.Option("--stop", help="End what an earlier hub left running, and exit.")
    ] = False,
) -> None:
    """Run the hub: it starts and watches engines and cells, shares out the radio, sets the policy.

    What an earlier hub started and still runs is taken over without being restarted.
    """
    logging.basicConfig(
        stream=sys.stderr, level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s"
    )
    logging.getLogger("websockets").setLevel(logging.WARNING)
    try:
        components = with_parameters(_components(config, cell or [], restarts), parameter or [])
        page = address_of(dashboard, "dashboard address") if dashboard else None
        aio.run(
            _stop(master, components)
            if end
            else _serve(master, components, standby, leave_running, page)
        )
    except (SimpleRosError, OSError) as error:
        reason = getattr(error, "strerror", None) or error
        typer.echo(f"{PROGRAM}: error: {reason}", err=True)
        raise typer.Exit(1) from None


def _components(config: Path | None, cells: list[str], restarts: int) -> tuple[Component, ...]:
    found = components_of(_read(config), str(config)) if config else default_components()
    document: dict[str, Any] = {}
    for name in filter(None, ",".join(cells).split(",")):
        priority = plugins.load(CELLS, name).priority
        document[f"{name}_cell"] = {"cell": name, "priority": priority}
    if document:
        engines = tuple(item.name for item in found)
        added = components_of({"components": document}, "--cell")
        found += tuple(replace(item, after=engines) for item in added)
    check_components(found)
    return tuple(
        replace(item, respawn=replace(RESPAWN, limit=restarts)) if item.respawn == RESPAWN else item
        for item in found
    )


def _read(path: Path) -> object:
    try:
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from None
    except yaml.YAMLError as error:
        raise ConfigError(f"{path}: {' '.join(str(error).split())}") from None


async def _serve(
    master: str | None,
    components: tuple[Component, ...],
    standby: bool,
    leave_running: bool,
    page: tuple[str, int] | None,
) -> None:
    node = aio.NodeHandle(NODE_NAME, master=master)
    with await _place(node.master, standby) as place:
        async with node:
            await node.wait_for_master()
            typer.echo(f"{PROGRAM}: Master {node.master}, logs in {place.directory}")
            ready()
            await Hub(node, place, components, leave_running=leave_running, dashboard=page).run()


async def _place(master: str, standby: bool) -> Place:
    waiting = False
    while True:
        try:
            return Place(directory_for(master))
        except HubRuns as error:
            if not standby:
                raise
            if not waiting:
                typer.echo(f"{PROGRAM}: standing by for the hub of process {error.pid}")
            waiting = True
            await asyncio.sleep(_LOOK_EVERY_S)


async def _stop(master: str | None, components: tuple[Component, ...]) -> None:
    node = aio.NodeHandle(NODE_NAME, master=master)
    with Place(directory_for(node.master)) as place:
        keeper = ProcessKeeper(place.directory, lambda _, __: None, node.master)
        found = keeper.recover({item.name: item for item in components})
        await keeper.close(leave_running=False)
        # The next hub must not take them for lost.
        place.remember(replace(Memory.of(place.remembered()), pids={}).facts())
        typer.echo(f"{PROGRAM}: ended {', '.join(found) or 'nothing'}")
