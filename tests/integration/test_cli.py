"""``simple-ros`` as a user runs it, against a real Master process."""

from __future__ import annotations

import json
import signal
import socket
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from importlib.metadata import version
from pathlib import Path

import pytest
from support.cpp_master import cpp_master
from support.processes import Process, master_process, python

from simple_ros.aio import NodeHandle
from simple_ros.graph import (
    GraphNode,
    GraphSnapshot,
    TopicKey,
    edges_between,
    to_dot,
    to_json,
    to_readable_string,
)
from simple_ros.msg.example import SensorData

PROGRAM = ("-m", "simple_ros.cli.main")
KEY = TopicKey("data", "example.SensorData")
WRITERS = {"readable": to_readable_string, "dot": to_dot, "json": to_json}


async def run(*arguments: str, **environment: str) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of ``simple-ros`` with these arguments."""
    async with python(*PROGRAM, *arguments, **environment) as process:
        assert process.process.stdout is not None
        stdout = (await process.process.stdout.read()).decode()
        return await process.wait(), stdout, await process.errors()


class TestGraph:
    @asynccontextmanager
    async def two_nodes(self) -> AsyncIterator[tuple[str, GraphSnapshot]]:
        """The address of a Master with two nodes, and what its graph has to be."""
        async with AsyncExitStack() as stack:
            _, address = await stack.enter_async_context(master_process())
            source = await stack.enter_async_context(NodeHandle("source", master=address))
            sink = await stack.enter_async_context(NodeHandle("sink", master=address))
            await source.advertise("data", SensorData)
            await sink.subscribe("data", SensorData, lambda _: None)
            nodes = (
                GraphNode("sink", "127.0.0.1", sink.port, subscribes=(KEY,)),
                GraphNode("source", "127.0.0.1", source.port, publishes=(KEY,)),
            )
            yield address, GraphSnapshot(nodes, edges_between(nodes))

    async def test_three_formats(self) -> None:
        async with self.two_nodes() as (address, graph):
            for name, write in WRITERS.items():
                expected = write(graph).removesuffix("\n") + "\n"
                shown = await run("graph", "--format", name, "--master", address)
                assert shown == (0, expected, "")
            by_environment = await run("graph", SIMPLE_ROS_MASTER=address)
            assert by_environment == (0, to_readable_string(graph), "")

    async def test_watch_tells_each_change_until_ctrl_c(self) -> None:
        async with self.two_nodes() as (address, graph):
            async with python(*PROGRAM, "graph", "--watch", "--master", address) as watch:
                for line in to_readable_string(graph).splitlines():
                    assert await watch.line() == line
                async with NodeHandle("third", master=address) as node:
                    publisher = await node.advertise("data", SensorData)
                    where = f"third (ip=127.0.0.1, port={node.port})"
                    assert await watch.line() == f"+ node {where}"
                    assert await watch.line() == "+ third publishes data : example.SensorData"
                    await publisher.close()
                    assert await watch.line() == "- third publishes data : example.SensorData"
                assert await watch.line() == f"- node {where}"
                await end_with_ctrl_c(watch)

    async def test_watch_in_json_is_a_document_a_line(self) -> None:
        async with self.two_nodes() as (address, graph):
            arguments = ("graph", "--watch", "--format", "json", "--master", address)
            async with python(*PROGRAM, *arguments) as watch:
                whole = json.loads(await watch.line())
                assert whole == {"event": "snapshot", **json.loads(to_json(graph))}
                async with NodeHandle("third", master=address) as node:
                    await node.subscribe("data", SensorData, lambda _: None)
                    found = {"name": "third", "ip": "127.0.0.1", "port": node.port}
                    assert json.loads(await watch.line()) == {"event": "node_added", **found}
                    assert json.loads(await watch.line()) == {
                        "event": "subscriber_added",
                        **found,
                        "topic": "data",
                        "msg": "example.SensorData",
                    }
                await end_with_ctrl_c(watch)

    async def test_no_master_is_one_clear_line(self) -> None:
        with socket.socket() as holder:  # bound and not listening: nobody answers
            holder.bind(("127.0.0.1", 0))
            address = f"127.0.0.1:{holder.getsockname()[1]}"
            code, stdout, stderr = await run("graph", "--master", address)
        assert (code, stdout) == (1, "")
        assert stderr.startswith(f"error: no Master answers at {address}; ")
        assert stderr.count("\n") == 1

    async def test_no_address_is_one_clear_line(self) -> None:
        code, _, stderr = await run("graph", "--master", "nowhere:port")
        assert code == 1
        assert stderr == "error: 'nowhere:port' is not an address; write host:port or [v6]:port\n"

    async def test_a_cpp_master_is_asked_node_by_node(self) -> None:
        nodes = (
            GraphNode("sink", "127.0.0.1", 60001, subscribes=(KEY,)),
            GraphNode("source", "127.0.0.1", 60000, publishes=(KEY,)),
        )
        graph = GraphSnapshot(nodes, edges_between(nodes))
        async with cpp_master(graph.nodes) as address:
            for name, write in WRITERS.items():
                expected = write(graph).removesuffix("\n") + "\n"
                shown = await run("graph", "--format", name, "--master", address)
                assert shown == (0, expected, "")
            code, _, stderr = await run("graph", "--watch", "--master", address)
            assert code == 1
            assert stderr.startswith("error: the Master at 127.0.0.1:")


async def end_with_ctrl_c(process: Process) -> None:
    process.signal(signal.SIGINT)
    assert await process.wait() == 0
    assert await process.errors() == ""


class TestTheCommand:
    async def test_version(self) -> None:
        assert await run("--version") == (0, f"simple-ros {version('simple-ros')}\n", "")

    async def test_help_lists_own_nouns_and_those_of_plugins(self) -> None:
        code, stdout, stderr = await run("--help")
        assert (code, stderr) == (0, "")
        for noun in ("demo", "graph", "master"):
            assert f" {noun} " in stdout

    async def test_a_plugin_runs(self) -> None:
        code, stdout, _ = await run("master", "--version")
        assert (code, stdout) == (0, f"simple-ros-master {version('simple-ros')}\n")

    async def test_start_is_light(self) -> None:
        """Help and errors shall not wait for what only a command needs."""
        code = "import sys, simple_ros.cli.main; print(*sys.modules)"
        async with python("-c", code) as process:
            modules = set((await process.line()).split())
        assert not modules & {"grpc", "numpy", "rich.live", "psutil", "simple_ros.aio"}


@pytest.fixture
def plugins(tmp_path: Path) -> str:
    """Where two plug-ins are installed: a sound one with commands below it, and a broken one."""
    metadata = tmp_path / "plugins-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: plugins\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(
        "[simple_ros.cli]\nsound = sound_plugin:app\nbroken = no_such_module:app\n"
    )
    (tmp_path / "sound_plugin.py").write_text(
        "import typer\n"
        "app = typer.Typer(help='Many things.')\n"
        "@app.command()\n"
        "def first(): print('first it is')\n"
        "@app.command()\n"
        "def second(): print('second it is')\n"
    )
    return str(tmp_path)


class TestPlugins:
    async def test_a_typer_app_has_commands_below_it(self, plugins: str) -> None:
        assert await run("sound", "second", PYTHONPATH=plugins) == (0, "second it is\n", "")

    async def test_a_broken_one_is_one_line_and_breaks_nothing(self, plugins: str) -> None:
        warning = (
            "warning: plug-in 'broken' (no_such_module:app) cannot be loaded: "
            "ModuleNotFoundError: No module named 'no_such_module'\n"
        )
        code, stdout, stderr = await run("--help", PYTHONPATH=plugins)
        assert (code, stderr) == (0, warning)
        for noun in ("demo", "graph", "master", "sound"):
            assert f" {noun} " in stdout
        code, _, stderr = await run("broken", PYTHONPATH=plugins)
        assert code == 2
        assert stderr.startswith(warning)
        assert await run("--version", PYTHONPATH=plugins) == await run("--version")
