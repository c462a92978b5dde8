"""``python -m simple_ros_hub.runner engine|cell NAME``: one component as a node.

The same as ``simple-ros engine run NAME`` and ``simple-ros cell run NAME``, without the command line's
imports: a component that is started again is missing meanwhile.
"""

from __future__ import annotations

import sys
from collections.abc import Awaitable, Callable

from simple_ros import aio, plugins
from simple_ros.engine import engine_named
from simple_ros.errors import SimpleRosError

__all__ = ["CELLS", "main"]

CELLS = "simple_ros.cells"


def main() -> None:
    """Run the component that the command line names."""
    kind, name = sys.argv[1:3]
    # What follows is for the node, not for it.
    del sys.argv[1:3]
    try:
        component = engine_named(name) if kind == "engine" else plugins.load(CELLS, name)()
        aio.run(_run(component.node_name, component.run))
    except SimpleRosError as error:
        sys.exit(f"error: {error}")


async def _run(node_name: str, work: Callable[[aio.NodeHandle], Awaitable[None]]) -> None:
    async with aio.NodeHandle(node_name) as node:
        await work(node)


if __name__ == "__main__":
    main()
