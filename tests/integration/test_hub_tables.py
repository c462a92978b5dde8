"""What a hub knows of the dead does not pile up: entries are counted, over deaths of a component."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import os
import signal
import sys
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from support.hubs import end_all
from support.waiting import until

from simple_ros import aio
from simple_ros.arguments import Arguments
from simple_ros.launch import Respawn
from simple_ros_hub.components import Component, Kind
from simple_ros_hub.conditions import View
from simple_ros_hub.hub import NODE_NAME, Hub
from simple_ros_hub.place import Place
from simple_ros_master import Master

# It sends to the hub and hears it, so each death breaks links both ways.
ENGINE = """
from simple_ros import aio
from simple_ros.msg.wireless_ros_msgs import EngineStatus, SystemStatus

async def main():
    async with aio.NodeHandle("eye") as node:
        await node.subscribe("/wireless_ros/system_status", SystemStatus, lambda _: None)
        status = await node.advertise("/wireless_ros/status", EngineStatus)
        alive = EngineStatus(name="wireless_ros/eye", state="active")
        node.create_timer(0.05, lambda _: status.publish(alive))
        await node.spin()

aio.run(main())
"""
# A process that came back at once would fail too often for the usual limit.
OFTEN = Respawn(limit=100, within_s=0.01, delay_s=0.01)
# The journal keeps a thousand; another test shows that it keeps no more.
BOUNDED_ELSEWHERE = {"simple_ros_hub.journal.Entry"}


@asynccontextmanager
async def running_hub(master: Master, directory: Path) -> AsyncIterator[Hub]:
    eye = Component("eye", Kind.ENGINE, (sys.executable, "-c", ENGINE), respawn=OFTEN)
    node = aio.NodeHandle(NODE_NAME, master=master.address, arguments=Arguments())
    with Place(directory) as place:
        async with node:
            hub = Hub(node, place, [eye])
            running = asyncio.create_task(hub.run())
            try:
                await until(lambda: hub.outlets is not None, "the hub")
                yield hub
            finally:
                running.cancel()
                with contextlib.suppress(asyncio.CancelledError):
                    await running
                end_all(directory)


def objects() -> Counter[str]:
    """Objects of the library and the hub, by type, and tasks that did not end."""
    gc.collect()
    types = Counter(
        f"{type(item).__module__}.{type(item).__qualname__}" for item in gc.get_objects()
    )
    ours = {
        name: n for name, n in types.items() if name.startswith(("simple_ros.", "simple_ros_hub."))
    }
    return Counter({**ours, "tasks": len(asyncio.all_tasks())})


async def test_deaths_of_an_engine_leave_nothing_behind(master: Master, tmp_path: Path) -> None:
    async with running_hub(master, tmp_path / "hub") as hub:

        def eye() -> View:
            return hub.supervision.view("eye")

        async def settled() -> None:
            # Heard of, and reached by the hub.
            await until(lambda: eye().works, "the engine")
            publisher = next(
                item for item in hub.node.endpoints.publishers if "system_status" in item.topic
            )
            await until(lambda: publisher.subscriber_count == 1, "the way to the engine")

        async def die(times: int) -> None:
            for _ in range(times):
                before = eye().pid
                os.kill(before, signal.SIGKILL)
                await until(lambda before=before: eye().pid not in (0, before), "the next one")
                await settled()

        await settled()
        # First what is made once, at the first death.
        await die(2)
        before = objects()
        await die(5)
        assert eye().restarts == 7
        more: dict[str, int] = {}

        def as_before() -> bool:
            more.clear()
            more.update(objects() - before)
            return not more.keys() - BOUNDED_ELSEWHERE

        with contextlib.suppress(AssertionError):
            # What is just under way may be there once more.
            await until(as_before, limit=10)
        assert not more.keys() - BOUNDED_ELSEWHERE, more
