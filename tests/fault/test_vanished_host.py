"""A host that vanishes: no goodbye, no reset, its links stay half open. Then it comes back.

Two network namespaces joined by a virtual cable that is cut and plugged in again. Needs root and the
``ip`` command of iproute2.
"""

from __future__ import annotations

import asyncio
import os
import shutil
import subprocess
import sys
import textwrap
from collections.abc import Iterator

import pytest
from support.waiting import Stopwatch, until

from simple_ros.aio import NodeHandle
from simple_ros.msg.example import SensorData
from simple_ros_master import Master

HERE, THERE = "10.231.77.1", "10.231.77.2"
ROBOT = textwrap.dedent(
    """
    import itertools
    from simple_ros import aio
    from simple_ros.msg.example import SensorData

    async def main():
        async with aio.NodeHandle("robot") as node:
            echo = await node.advertise("echo", SensorData)
            await node.subscribe("sensor", SensorData, echo.publish)
            await node.spin()

    aio.run(main())
    """
)


def ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True)


@pytest.fixture
def cable() -> Iterator[tuple[str, str]]:
    """A namespace that is another host, and the near end of the cable to it."""
    name = f"sr{os.getpid()}"
    near, far = f"{name}a", f"{name}b"
    if shutil.which("ip") is None:
        pytest.skip("needs the 'ip' command (apt-get install iproute2)")
    try:
        ip("netns", "add", name)
    except subprocess.CalledProcessError as error:
        pytest.skip(f"cannot make a network namespace (needs root): {error.stderr.decode()}")
    try:
        ip("link", "add", near, "type", "veth", "peer", "name", far, "netns", name)
        ip("addr", "add", f"{HERE}/24", "dev", near)
        ip("link", "set", near, "up")
        ip("-n", name, "addr", "add", f"{THERE}/24", "dev", far)
        ip("-n", name, "link", "set", far, "up")
        ip("-n", name, "link", "set", "lo", "up")
        yield name, near
    finally:
        ip("netns", "del", name)


@pytest.mark.slow
async def test_a_vanished_host_is_missed_and_welcomed_back(cable: tuple[str, str]) -> None:
    namespace, near = cable
    echoed: list[int] = []
    async with Master(host=HERE, port=0) as master:
        robot = await asyncio.create_subprocess_exec(
            *("ip", "netns", "exec", namespace, sys.executable, "-c", ROBOT),
            env=os.environ | {"SIMPLE_ROS_MASTER": master.address},
        )
        try:
            async with NodeHandle("base", master=master.address) as base:
                assert base.ip == HERE
                echo = await base.subscribe(
                    "echo", SensorData, lambda message: echoed.append(message.sensor_id)
                )
                publisher = await base.advertise("sensor", SensorData)

                def robot_is_known() -> bool:
                    return "robot" in {node.name for node in master.graph.snapshot().nodes}

                async def echoes(number: int) -> None:
                    # What is sent while a link is half open is lost: keep on sending.
                    timer = base.create_timer(
                        0.1, lambda event: publisher.publish(SensorData(sensor_id=number))
                    )
                    await until(lambda: echoed[-1:] == [number])
                    timer.close()

                await until(lambda: publisher.targets and robot_is_known())
                (target,) = publisher.targets
                assert target.ip == THERE
                await echoes(1)

                ip("link", "set", near, "down")
                watch = Stopwatch()
                await until(lambda: not robot_is_known(), "its lease is lost")
                assert watch.seconds < 8.0
                await until(lambda: not publisher.targets, "its link is given up")
                await until(lambda: echo.publisher_count == 0, "its link here is closed")
                assert watch.seconds < 20.0

                ip("link", "set", near, "up")
                watch = Stopwatch()
                await until(robot_is_known, "it registers again by itself")
                assert watch.seconds < 10.0
                await until(lambda: publisher.targets)
                await echoes(2)
        finally:
            robot.terminate()
            await robot.wait()
