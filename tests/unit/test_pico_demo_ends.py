"""Ctrl-C ends the demo, also when it comes together with a message."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any, cast

import pytest

from simple_ros.aio import NodeHandle
from simple_ros.msg.nav_msgs import Odometry
from simple_ros_firmware_bridge import demo


class Node:
    """What the demo uses of a node."""

    def __init__(self) -> None:
        self.came: asyncio.Future[Callable[[Odometry], None]] = asyncio.Future()
        self.commands = 0

    async def subscribe(self, _topic: str, _type: Any, callback: Any) -> None:
        self.came.set_result(callback)

    async def advertise(self, *_: Any) -> Node:
        return self

    def publish(self, _: Any) -> None:
        self.commands += 1


@pytest.mark.parametrize("iterations", range(6))
async def test_a_message_does_not_swallow_the_end(
    iterations: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(demo, "_PERIOD_S", 0.0)
    node = Node()
    driving = asyncio.create_task(demo._drive(cast("NodeHandle", node), 60.0, 1.0))
    came = await node.came
    while not node.commands:
        came(Odometry())
        await asyncio.sleep(0)
    for _ in range(20):
        await asyncio.sleep(0)
    came(Odometry())
    for _ in range(iterations):
        await asyncio.sleep(0)
    driving.cancel()
    done, _ = await asyncio.wait([driving], timeout=5)
    assert driving in done
    assert driving.cancelled()
