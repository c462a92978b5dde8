"""The command ``simple-ros pico simulator``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from simple_ros import aio

if TYPE_CHECKING:
    from simple_ros_firmware_bridge.simulator.firmware import Firmware

__all__ = ["simulator"]


def simulator(
    link: Annotated[
        Path | None,
        typer.Option(metavar="PATH", dir_okay=False, help="Make this path point to the port."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Of the noise of its sensors.")] = 1,
    old_names: Annotated[
        bool, typer.Option("--old-names", help="Topics /ddd/... as in the first firmware.")
    ] = False,
    gives_up: Annotated[
        bool, typer.Option("--gives-up", help="Begin anew when the agent knows nothing of it.")
    ] = False,
) -> None:
    """Run a board that does not exist on a serial port that does not exist either."""
    from simple_ros_firmware_bridge.simulator.firmware import Firmware

    aio.run(_serve(Firmware(seed, old_names=old_names, gives_up=gives_up), link))


async def _serve(firmware: Firmware, link: Path | None) -> None:
    import asyncio

    from simple_ros_firmware_bridge.simulator.pty_board import PtyBoard

    async with PtyBoard(firmware, link) as board:
        typer.echo(f"pico simulator: on {link or board.path}")
        await asyncio.Event().wait()
