"""The command ``simple-ros pico controller``."""

from __future__ import annotations

import logging
import sys
from typing import Annotated

import typer

from simple_ros import aio
from simple_ros.errors import SimpleRosError
from simple_ros.ready import ready
from simple_ros_firmware_bridge.node_words import Words, take_words

__all__ = ["controller"]


def controller(
    words: Words = None,
    master: Annotated[
        str | None, typer.Option(metavar="HOST:PORT", help="Where the Master is.")
    ] = None,
) -> None:
    """Run the control loop of robot_xl: cmd_vel in, hardware/cmd_vel and odometry out."""
    logging.basicConfig(
        stream=sys.stderr, level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s"
    )
    take_words(words)
    try:
        aio.run(_serve(master))
    except SimpleRosError as error:
        typer.echo(f"error: {error}", err=True)
        raise typer.Exit(1) from None


async def _serve(master: str | None) -> None:
    # Imported here: the bridge, which shares the command line, starts the sooner.
    from simple_ros_firmware_bridge.control.manager import ControllerManager
    from simple_ros_firmware_bridge.control.settings import declared_settings, wants_mock

    async with aio.NodeHandle("controller_manager", master=master) as node:
        settings = await declared_settings(node)
        manager = await ControllerManager.create(node, settings, is_mock=wants_mock())
        ready()
        try:
            await node.spin()
        finally:
            await manager.close()
