"""What the documentation of the network exposure engine claims."""

from __future__ import annotations

import difflib
import re
import signal
from importlib.metadata import entry_points
from importlib.resources import files
from pathlib import Path

import pytest
from support.cli import run
from support.engines import at_work, user
from support.processes import python
from support.waiting import until

from simple_ros.engine import Engine
from simple_ros.msg.geometry_msgs import Twist
from simple_ros_engines.network_exposure.mock.core import MockSettings
from simple_ros_engines.network_exposure.mock.server import MockServer
from simple_ros_engines.network_exposure.relay import FlowRelay
from simple_ros_engines.network_exposure.topic_watcher import TopicWatcher
from simple_ros_master import Master

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "tagged_topic"
PAGE = (ROOT / "docs" / "network-exposure.md").read_text("utf-8")


def changed_lines() -> list[str]:
    before, after = (
        (EXAMPLE / name).read_text("utf-8").splitlines() for name in ("before.py", "after.py")
    )
    return [line for line in difflib.ndiff(before, after) if line.startswith(("-", "+"))]


class TestOneTag:
    """An application changes one word."""

    def test_nothing_else_is_different(self) -> None:
        removed, added = changed_lines()
        assert removed.startswith("-")
        assert added[1:] == removed[1:].replace('"cmd_vel"', '"cmd_vel_qos"')

    def test_the_page_shows_that_diff(self) -> None:
        (block,) = re.findall(r"```diff\n(.*?)```", PAGE, re.DOTALL)
        shown = [line[0] + line[1:].strip() for line in block.splitlines()]
        assert shown == [line[0] + line[1:].strip() for line in changed_lines()]

    async def test_before_it_is_an_ordinary_topic(self, master: Master) -> None:
        got: list[Twist] = []
        async with user(master) as node, at_work(FlowRelay(), master):
            await node.subscribe("cmd_vel", Twist, got.append)
            async with python(str(EXAMPLE / "before.py"), SIMPLE_ROS_MASTER=master.address) as app:
                await until(lambda: len(got) > 3)
                app.signal(signal.SIGINT)
                assert await app.wait() == 0
                assert await app.errors() == ""

    async def test_after_it_the_network_is_asked(self, master: Master) -> None:
        got: list[Twist] = []
        async with MockServer(MockSettings(setup_s=0.0)) as mock, user(master) as node:
            await node.subscribe("cmd_vel", Twist, got.append)
            async with (
                at_work(FlowRelay(), master, stats_period_s=0.05),
                at_work(TopicWatcher(), master, url=mock.url, min_window_s=0.2),
                python(str(EXAMPLE / "after.py"), SIMPLE_ROS_MASTER=master.address) as app,
            ):
                await until(lambda: mock.network.bearers)
                assert got[-1].linear.x == 0.5
                app.signal(signal.SIGINT)
                assert await app.wait() == 0
                assert await app.errors() == ""


@pytest.mark.parametrize("engine", [FlowRelay(), TopicWatcher()], ids=lambda one: one.node_name)
async def test_the_page_names_every_parameter(master: Master, engine: Engine) -> None:
    async with at_work(engine, master) as node:
        last = "dscp" if isinstance(engine, FlowRelay) else "idle_s"
        await until(lambda: any(name.endswith(last) for name in node.parameters))
        names = {name.removeprefix("~") for name in node.parameters}
        assert len(names) > 15
        assert sorted(name for name in names if f"`{name}`" not in PAGE) == []


def test_the_readme_names_every_engine() -> None:
    text = (ROOT / "engines" / "README.md").read_text("utf-8")
    found = [
        point.name
        for point in entry_points(group="simple_ros.engines")
        if point.value.startswith("simple_ros_engines.")
    ]
    assert len(found) >= 11
    assert [name for name in found if f"`{name}`" not in text] == []


@pytest.mark.parametrize("folder", ["launch", "turtlesim/launch"])
async def test_launch_files_make_sense(folder: str) -> None:
    found = sorted((files("simple_ros_engines.network_exposure") / folder).iterdir())
    assert found
    for file in found:
        code, text, errors = await run("launch", str(file), "--show")
        assert (code, errors) == (0, "")
        assert "flow_relay" in text
    code, text, errors = await run("launch", str(found[0]), "mode:=fast", "--show")
    assert code != 0
