"""The link shaper as a process, and nodes at its sites."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import yaml

from simple_ros.arguments import Arguments
from simple_ros.node import NodeHandle
from simple_ros_engines.link_shaper.transport import ShapedTransport
from support.processes import Process, python


@asynccontextmanager
async def shaper(
    folder: Path, data: dict[str, Any], master: str = ""
) -> AsyncIterator[tuple[Process, str]]:
    """A shaper on a free port; gives its process and its address. Without a Master it is no node."""
    file = folder / "shaper.yaml"
    file.write_text(yaml.safe_dump({"listen": "127.0.0.1:0"} | data))
    more = ["--master", master] if master else ["--no-node"]
    async with python("-m", "simple_ros.cli.main", "link", "shape", str(file), *more) as process:
        line = await process.line()
        assert line.startswith("link shaper (simulated): listening on ")
        yield process, line.rsplit(" ", 1)[1]


def at(site: str, where: str, name: str, master: str) -> NodeHandle:
    """A node at a site."""
    ways = (ShapedTransport(site, where),)
    return NodeHandle(name, master=master, transports=ways, arguments=Arguments())


def environment(site: str, where: str, master: str) -> dict[str, str]:
    """For a node program at a site."""
    return {
        "SIMPLE_ROS_MASTER": master,
        "SIMPLE_ROS_TRANSPORTS": "local,shaped",
        "SIMPLE_ROS_SITE": site,
        "SIMPLE_ROS_LINK_SHAPER": where,
    }
