"""The wireless engines in tests: an engine at work, a user beside it."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from simple_ros.aio import NodeHandle
from simple_ros.arguments import Arguments
from simple_ros.engine import Engine
from simple_ros_master import Master


@asynccontextmanager
async def at_work(
    engine: Engine, master: Master, *, name: str = "", **parameters: Any
) -> AsyncIterator[NodeHandle]:
    """An engine at work, with parameters set before it starts."""
    async with NodeHandle(
        name or engine.node_name, master=master.address, arguments=Arguments()
    ) as node:
        await node.set_parameters({f"~{key}": value for key, value in parameters.items()})
        task = asyncio.create_task(engine.run(node))
        try:
            yield node
        finally:
            task.cancel()
            (ended,) = await asyncio.gather(task, return_exceptions=True)
            if ended is not None and not isinstance(ended, asyncio.CancelledError):
                raise ended


@asynccontextmanager
async def user(master: Master) -> AsyncIterator[NodeHandle]:
    """A node of somebody who listens."""
    async with NodeHandle("user", master=master.address, arguments=Arguments()) as node:
        yield node


def source(name: str, **options: Any) -> dict[str, str]:
    """The parameters that choose a source of metrics."""
    return {"source": name, "source_options": json.dumps(options)}
