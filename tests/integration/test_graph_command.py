"""``simple-ros graph``: files, drawings and filters, against a real Master process."""

from __future__ import annotations

import os
import shutil
import stat
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path

import pytest
from support.processes import master_process, python

from simple_ros.aio import NodeHandle
from simple_ros.msg.example import SensorData
from simple_ros.msg.geometry_msgs import Twist
from simple_ros.net.master_client import MasterClient
from simple_ros.rpc import methods
from simple_ros.rpc import ros_rpc_pb2 as ros

EVIL = "</script><script>alert(1)</script>"


async def graph(*arguments: str, **environment: str) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of ``simple-ros graph`` with these arguments."""
    async with python("-m", "simple_ros.cli.main", "graph", *arguments, **environment) as process:
        assert process.process.stdout is not None
        stdout = (await process.process.stdout.read()).decode()
        return await process.wait(), stdout, await process.errors()


@asynccontextmanager
async def robot() -> AsyncIterator[str]:
    """The address of a Master with three nodes of which two are linked."""
    async with AsyncExitStack() as stack:
        _, address = await stack.enter_async_context(master_process())
        planner, base, alone = [
            await stack.enter_async_context(NodeHandle(name, master=address))
            for name in ("planner", "base", "alone")
        ]
        await planner.advertise("cmd_vel", Twist)
        await base.subscribe("cmd_vel", Twist, lambda _: None)
        await alone.advertise("data", SensorData)
        yield address


async def test_a_file_is_written_in_the_format_of_its_name(tmp_path: Path) -> None:
    beginnings = {
        "graph.txt": "==== Message Graph ====\nNodes: 3, Edges: 1\n",
        "graph.dot": "digraph RosGraph {\n",
        "graph.json": '{\n  "edges": [\n',
        "graph.mmd": 'flowchart LR\n  n0["alone"]\n  n1["base"]\n  n2["planner"]\n  n2 -->|"cmd_vel"| n1\n',
        "graph.HTML": "<!DOCTYPE html>\n",
    }
    async with robot() as address:
        for name, beginning in beginnings.items():
            path = tmp_path / name
            assert await graph("-o", str(path), "--master", address) == (0, "", "")
            assert path.read_text().startswith(beginning)
        other = tmp_path / "graph.html"
        await graph("-o", str(other), "--format", "json", "--master", address)
        assert other.read_text() == (tmp_path / "graph.json").read_text()


async def test_what_cannot_be_written_is_one_clear_line(tmp_path: Path) -> None:
    async with robot() as address:
        path = str(tmp_path / "nowhere" / "graph.dot")
        code, stdout, stderr = await graph("-o", path, "--master", address)
    assert (code, stdout) == (1, "")
    assert stderr == f"error: cannot write {path!r}: No such file or directory\n"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("-o", "graph.pdf"), ("graph.pdf", ".html")),
        (("--topics",), ("--topics", "mermaid")),
        (("--topics", "--format", "json"), ("--topics", "json")),
        (("--watch", "--format", "html"), ("--watch", "readable")),
        (("--watch", "-o", "graph.json"), ("--watch", "terminal")),
    ],
)
async def test_what_makes_no_sense_is_refused(arguments, words) -> None:
    code, stdout, stderr = await graph(*arguments)
    assert (code, stdout) == (2, "")
    for word in words:
        assert word in stderr


async def test_topics_and_filter() -> None:
    async with robot() as address:
        options = ("--master", address, "--filter", "/cmd_vel")
        _, shown, _ = await graph(*options)
        assert shown.startswith("==== Message Graph ====\nNodes: 2, Edges: 1\n")
        assert "alone" not in shown
        _, shown, _ = await graph(*options, "--topics", "--format", "mermaid")
        assert shown == (
            "flowchart LR\n"
            '  n0["base"]\n'
            '  n1["planner"]\n'
            '  t0(["cmd_vel<br/>geometry_msgs.Twist"])\n'
            "  t0 --> n0\n"
            "  n1 --> t0\n"
        )


async def test_watch_tells_only_what_the_filter_asks_for() -> None:
    async with robot() as address:
        program = ("-m", "simple_ros.cli.main", "graph", "--watch", "--filter", "wanted")
        async with python(*program, "--master", address) as watch:
            for _ in range(6):
                await watch.line()
            async with NodeHandle("noise", master=address) as node:
                await node.advertise("noise", SensorData)
                async with NodeHandle("wanted", master=address):
                    assert (await watch.line()).startswith("+ node wanted ")


async def test_a_name_that_means_harm_stays_text(tmp_path: Path) -> None:
    path = tmp_path / "graph.html"
    async with master_process() as (_, address), MasterClient(address) as client:
        await client.call(
            methods.REGISTER_PUBLISHER,
            ros.RegisterPublisherRequest(
                topic_name=EVIL,
                msg_type=EVIL,
                node_info=ros.NodeInfo(node_name=EVIL, ip=EVIL, port=0),
            ),
        )
        assert await graph("-o", str(path), "--topics", "--master", address) == (0, "", "")
    text = path.read_text()
    assert EVIL not in text
    assert "&lt;/script&gt;&lt;script&gt;alert(1)" in text


class TestSvg:
    async def test_without_graphviz(self, tmp_path: Path) -> None:
        async with robot() as address:
            code, stdout, stderr = await graph(
                "--format", "svg", "--master", address, PATH=str(tmp_path)
            )
        assert (code, stdout) == (1, "")
        assert stderr.startswith(
            "error: svg is drawn by Graphviz, which is not installed: 'apt install"
        )
        assert "html" in stderr

    async def test_graphviz_gets_the_graph_and_its_picture_is_written(self, tmp_path: Path) -> None:
        self.stand_in(tmp_path, 'echo "<svg>$1"; cat; echo "</svg>"')
        async with robot() as address:
            _, dot, _ = await graph("--format", "dot", "--topics", "--master", address)
            picture = tmp_path / "graph.svg"
            arguments = ("-o", str(picture), "--topics", "--master", address)
            assert await graph(*arguments, PATH=self.path(tmp_path)) == (0, "", "")
        assert picture.read_text() == f"<svg>-Tsvg\n{dot}</svg>\n"

    async def test_graphviz_fails(self, tmp_path: Path) -> None:
        self.stand_in(tmp_path, "cat > /dev/null; echo 'out of ink' >&2; exit 3")
        async with robot() as address:
            code, _, stderr = await graph(
                "--format", "svg", "--master", address, PATH=self.path(tmp_path)
            )
        assert code == 1
        assert stderr.startswith("error: Graphviz failed (code 3): out of ink; ")

    @pytest.mark.skipif(shutil.which("dot") is None, reason="needs Graphviz")
    async def test_the_real_one(self) -> None:
        async with robot() as address:
            code, stdout, stderr = await graph("--format", "svg", "--topics", "--master", address)
        assert (code, stderr) == (0, "")
        assert "</svg>" in stdout
        assert "cmd_vel" in stdout

    @staticmethod
    def path(folder: Path) -> str:
        return f"{folder}{os.pathsep}{os.environ['PATH']}"

    @staticmethod
    def stand_in(folder: Path, script: str) -> None:
        program = folder / "dot"
        program.write_text(f"#!/bin/sh\n{script}\n")
        program.chmod(program.stat().st_mode | stat.S_IXUSR)
