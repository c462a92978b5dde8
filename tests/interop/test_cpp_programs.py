"""Unmodified C++ simple_ros programs with ours, under either Master.

Collected only when SIMPLE_ROS_CPP_BIN names the directory of those programs. They have fixed ports, so
each test runs in a network namespace of its own, which needs root.
"""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
import textwrap
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

CPP = Path(os.environ["SIMPLE_ROS_CPP_BIN"])
LIMIT_S = 20.0
pytestmark = pytest.mark.slow

COUNTER = """
    import sys
    from simple_ros import aio

    async def main():
        counts = {}
        async with aio.NodeHandle("counter") as node:
            async def follow(topic, kind):
                def count(message):
                    counts[topic] = counts.get(topic, 0) + 1
                    if counts[topic] == 30:
                        print(topic, flush=True)
                await node.subscribe(topic, kind, count)
            await follow("quad_odometry", "geometry_msgs.Odometry")
            await follow("quad_marker_array", "visualization_msgs.MarkerArray")
            await follow("quad_path_short", "visualization_msgs.Marker")
            await follow("quad_path_incremental", "visualization_msgs.Marker")
            print("ready", flush=True)
            await node.spin()

    aio.run(main())
"""
TOPICS = {"quad_odometry", "quad_marker_array", "quad_path_short", "quad_path_incremental"}
OUR_MASTER = [sys.executable, "-m", "simple_ros_master"]
OUR_SIMULATOR = [sys.executable, "-m", "simple_ros.demos.quad_simulator"]
OUR_VISUALIZER = [sys.executable, "-m", "simple_ros.demos.quad_visualizer"]


@pytest.fixture
def space() -> Iterator[list[str]]:
    """A network of its own; gives the words that run a command in it."""
    name = f"srcpp{os.getpid()}"
    subprocess.run(["ip", "netns", "add", name], check=True)
    try:
        subprocess.run(["ip", "-n", name, "link", "set", "lo", "up"], check=True)
        yield ["ip", "netns", "exec", name]
    finally:
        subprocess.run(["ip", "netns", "del", name], check=True)


@asynccontextmanager
async def running(space: list[str], *command: str) -> AsyncIterator[asyncio.subprocess.Process]:
    process = await asyncio.create_subprocess_exec(
        *space, *command, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.DEVNULL
    )
    try:
        yield process
    finally:
        if process.returncode is None:
            process.terminate()
        await asyncio.wait_for(process.communicate(), LIMIT_S)


def cpp(name: str, *words: str) -> list[str]:
    return ["stdbuf", "-oL", str(CPP / name), *words]


async def output(space: list[str], *command: str) -> str:
    process = await asyncio.create_subprocess_exec(
        *space, *command, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.DEVNULL
    )
    raw, _ = await asyncio.wait_for(process.communicate(), LIMIT_S)
    return raw.decode()


async def line(process: asyncio.subprocess.Process, containing: str) -> str:
    assert process.stdout is not None
    async with asyncio.timeout(LIMIT_S):
        while True:
            raw = await process.stdout.readline()
            assert raw, "process ended"
            if containing in raw.decode():
                return raw.decode()


async def listed(space: list[str], *names: str, gone: bool = False) -> None:
    """Wait until C++ rosnode shows (or no longer shows) all of these nodes."""
    async with asyncio.timeout(LIMIT_S):
        while True:
            text = await output(space, *cpp("rosnode", "list"))
            if all((f"* {name} " in text) is not gone for name in names):
                return


async def all_four_topics_flow(space: list[str]) -> None:
    async with running(space, sys.executable, "-c", textwrap.dedent(COUNTER)) as counter:
        await line(counter, "ready")
        seen = {(await line(counter, "quad_")).strip() for _ in TOPICS}
        assert seen == TOPICS


async def started_cpp_master(process: asyncio.subprocess.Process, space: list[str]) -> None:
    async with asyncio.timeout(LIMIT_S):
        while "50051" not in await output(space, "ss", "-ltnH"):
            pass


async def test_cpp_nodes_and_tools_under_our_master(space: list[str]) -> None:
    async with running(space, *OUR_MASTER) as master:
        await line(master, "listening")
        async with running(space, *cpp("quad_simulator")) as simulator:
            await listed(space, "quad_simulator")
            async with running(space, *cpp("quad_visualizer")):
                await listed(space, "quad_simulator", "quad_visualizer")
                await all_four_topics_flow(space)
                info = await output(space, *cpp("rosnode", "info", "quad_visualizer"))
                assert "  * quad_marker_array (visualization_msgs.MarkerArray)" in info
                topics = await output(space, *cpp("rostopic", "list"))
                assert " * quad_odometry [geometry_msgs.Odometry]" in topics
                topic = await output(space, *cpp("rostopic", "info", "quad_odometry"))
                assert "quad_simulator" in topic
                async with running(space, *cpp("rostopic", "echo", "quad_odometry")) as echo:
                    for _ in range(3):
                        await line(echo, "[geometry_msgs.Odometry]")
                simulator.kill()
                await listed(space, "quad_simulator", gone=True)


async def test_ours_and_theirs_mixed_under_our_master(space: list[str]) -> None:
    async with running(space, *OUR_MASTER) as master:
        await line(master, "listening")
        async with running(space, *cpp("quad_visualizer")):
            await listed(space, "quad_visualizer")
            async with running(space, *OUR_SIMULATOR):
                await all_four_topics_flow(space)


async def test_our_nodes_under_the_cpp_master(space: list[str]) -> None:
    async with running(space, *cpp("master")) as master:
        await started_cpp_master(master, space)
        async with running(space, *OUR_SIMULATOR):
            await listed(space, "quad_simulator")
            async with running(space, *OUR_VISUALIZER):
                await listed(space, "quad_visualizer")
                await all_four_topics_flow(space)
                async with running(space, *cpp("rostopic", "echo", "quad_path_short")) as echo:
                    await line(echo, "[visualization_msgs.Marker]")
                assert master.returncode is None
        await listed(space, "quad_simulator", "quad_visualizer", gone=True)
        assert master.returncode is None


async def test_mixed_under_the_cpp_master(space: list[str]) -> None:
    async with running(space, *cpp("master")) as master:
        await started_cpp_master(master, space)
        async with running(space, *OUR_SIMULATOR):
            await listed(space, "quad_simulator")
            async with running(space, *cpp("quad_visualizer")):
                await listed(space, "quad_visualizer")
                await all_four_topics_flow(space)
                assert master.returncode is None
