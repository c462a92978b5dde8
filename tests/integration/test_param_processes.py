"""Parameters across processes: Masters that are killed, command lines, files, the blocking face."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from support.processes import Process, master_process, program, python
from support.waiting import LIMIT_S, until

from simple_ros.aio import NodeHandle
from simple_ros.blocking import BlockingNode
from simple_ros.errors import MasterUnavailable
from simple_ros.net.loop import BackgroundLoop
from simple_ros.parameters.errors import ParameterRefused, UnknownParameter
from simple_ros.parameters.feed import ParameterChanged
from simple_ros.parameters.watching import ParameterWatch
from simple_ros.system_manager import NodeHandle as BlockingHandle
from simple_ros.system_manager import SystemManager
from simple_ros_master import Master

DRIVER = """
from simple_ros import aio

async def main():
    async with aio.NodeHandle("driver") as node:
        gain = await node.declare_parameter("~gain", 1.0, maximum=5)
        mode = await node.declare_parameter("~mode", "slow")
        print(node.name, gain, mode)
        node.on_parameter_changed("~gain", lambda value: print("gain", value))
        await node.spin()

aio.run(main())
"""


def keeping(file: Path, port: int = 0) -> Any:
    return python("-m", "simple_ros_master", "--port", str(port), "--parameters", str(file))


async def address_of(process: Process) -> str:
    return (await process.line()).rsplit(" ", 1)[1]


async def test_a_killed_master_loses_nothing_that_a_node_uses() -> None:
    async with master_process() as (first, address):
        port = int(address.rsplit(":", 1)[1])
        async with (
            program(DRIVER, "_mode:=fast", "__ns:=robot1", master=address) as driver,
            NodeHandle("tool", master=address) as tool,
        ):
            assert await driver.line() == "robot1/driver 1.0 fast"
            assert await driver.line() == "gain 1.0"
            watch = await tool.watch_parameters("robot1")
            await tool.set_parameters({"robot1/driver/gain": 2})
            assert await driver.line() == "gain 2.0"
            while (await watch.receive(30)).value != 2.0:
                pass
            await killed_and_restarted(first, port, 3.0, driver, tool, watch)


async def killed_and_restarted(
    first: Process,
    port: int,
    value: float,
    driver: Process,
    tool: NodeHandle,
    watch: ParameterWatch,
) -> None:
    """Kill the Master and start another one; nobody notices more than that."""
    name = "robot1/driver/gain"
    await first.kill()
    async with master_process(port):
        await known(tool, name)
        used = {name: value - 1, "robot1/driver/mode": "fast"}
        await until(lambda: dict(watch.values) == used)
        await tool.set_parameters({name: value})
        assert await driver.line() == f"gain {value}"
        while (await watch.receive(30)).value != value:
            pass
        with pytest.raises(TimeoutError):
            await watch.receive(0.01)


async def known(tool: NodeHandle, name: str) -> None:
    """Wait until the Master knows a parameter that a node declares."""
    async with asyncio.timeout(30):
        while True:
            with contextlib.suppress(UnknownParameter, MasterUnavailable):
                if (await tool.describe_parameter(name)).nodes:
                    return
            await asyncio.sleep(0.005)


async def test_what_was_set_outlives_the_master_in_its_file(tmp_path: Path) -> None:
    file = tmp_path / "robot.yaml"
    async with keeping(file) as first:
        address = await address_of(first)
        port = int(address.rsplit(":", 1)[1])
        async with NodeHandle("d", master=address) as node:
            await node.declare_parameter("~default", 1)
            await node.set_parameters({"max_speed": 2.5, "d": {"kept": [1, 2]}})
            await until(file.exists)
            await first.kill()
    assert file.read_text() == "d:\n  kept: [1, 2]\nmax_speed: 2.5\n"
    async with keeping(file, port) as second:
        await address_of(second)
        async with NodeHandle("d", master=address) as node:
            assert await node.get_parameter("max_speed") == 2.5
            assert await node.declare_parameter("~kept", [0.5]) == [1.0, 2.0]
            await node.delete_parameter("max_speed")
        second.signal(signal.SIGTERM)
        assert await second.wait() == 0
    assert file.read_text() == "d:\n  kept: [1.0, 2.0]\n"
    left = await asyncio.to_thread(lambda: [path.name for path in tmp_path.iterdir()])
    assert left == ["robot.yaml"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: 1\nb: [1, x]\n", "robot.yaml:2: parameter 'b': mixes int and string"),
        (None, "there is no folder"),
    ],
)
async def test_a_broken_file_is_an_error(tmp_path: Path, text: str | None, message: str) -> None:
    file = tmp_path / "robot.yaml" if text is not None else tmp_path / "no" / "robot.yaml"
    if text is not None:
        file.write_text(text)
    async with keeping(file) as process:
        assert await process.wait() == 1
        assert message in await process.errors()


async def test_a_file_that_cannot_be_written_is_said_and_tried_again(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("simple_ros_master.parameter_store._RETRY_S", 0.01)
    monkeypatch.setattr("simple_ros_master.parameter_store._GATHER_S", 0.01)
    folder = tmp_path / "kept"
    folder.mkdir()
    async with Master(port=0, parameters=folder / "p.yaml") as master:
        folder.rename(tmp_path / "away")
        async with NodeHandle("n", master=master.address) as node:
            await node.set_parameters({"x": 1})
            await until(lambda: "is not written: No such file" in caplog.text)
            (tmp_path / "away").rename(folder)
            await until(lambda: (folder / "p.yaml").exists())


async def test_words_from_launch_and_from_the_command_line(master: Master, tmp_path: Path) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text("/**: {mode: filed}\nrobot1/driver: {gain: 3}\n")
    where = {"SIMPLE_ROS_MASTER": master.address}
    words = f"__ns:=robot1 '__params:={file}' '_mode:=two words'"
    async with python("-c", DRIVER, SIMPLE_ROS_ARGS=words, **where) as told:
        assert await told.line() == "robot1/driver 3.0 two words"
    async with python("-c", DRIVER, "_gain:=4", "__name:=d", SIMPLE_ROS_ARGS=words, **where) as d:
        assert await d.line() == "robot1/d 4.0 two words"
    async with python("-c", DRIVER, "__nmae:=d", **where) as wrong:
        assert await wrong.wait() == 1
        errors = await wrong.errors()
        assert "did you mean '__name'?:\n  '__nmae:=d'\n   ^" in errors


@pytest.fixture
def system() -> Iterator[SystemManager]:
    loop = BackgroundLoop()
    master = Master(port=0)
    loop.run(master.start())
    manager = SystemManager.instance()
    manager.init("blocking", master=master.address, namespace="ns")
    yield manager
    manager.shutdown()
    loop.run(master.stop())
    loop.stop()


def spin_until(system: SystemManager, condition: Any, limit: float = LIMIT_S) -> None:
    end = time.monotonic() + limit
    while not condition():
        assert time.monotonic() < end, "not within the limit"
        system.spin_once(0.02)


def test_the_blocking_face(system: SystemManager) -> None:
    node: BlockingNode = BlockingHandle()
    tool = BlockingHandle("tool", master=node.master)
    assert (node.name, node.namespace, node.resolve_name("~x")) == (
        "ns/blocking",
        "ns",
        "ns/blocking/x",
    )
    assert node.declare_parameter("~gain", 1.0, maximum=5) == 1.0
    assert dict(node.parameters) == {"~gain": 1.0}
    seen: list[Any] = []
    told: list[ParameterChanged] = []
    judged: list[Any] = []

    def judge(values: dict[str, Any]) -> str | None:
        judged.append(values)
        return "too much" if values["~gain"] > 4 else None

    node.on_set_parameters(judge)
    node.on_parameter_changed("~gain", seen.append)
    watch = tool.watch_parameters("ns", told.append)
    # Its own values are judged in this thread, though nobody spins.
    node.set_parameters({"~gain": 2})
    with pytest.raises(ParameterRefused, match="too much"):
        node.set_parameters({"~gain": 4.5, "other": 1})
    assert judged == [{"~gain": 2.0}, {"~gain": 4.5}]
    assert node.get_parameter("~gain") == tool.get_parameter("/ns/blocking/gain") == 2.0
    assert seen == told == []
    spin_until(system, lambda: seen == [1.0, 2.0] and told and told[-1].value == 2.0)
    assert not tool.has_parameter("other")
    assert tool.list_parameters("/ns") == ["ns/blocking/gain"]
    assert tool.describe_parameter("/ns/blocking/gain").nodes == ("ns/blocking",)
    assert watch.prefix == "ns"
    watch.close()
    with tool.watch_parameters("ns") as quiet:
        assert quiet.receive(30).value == 2.0
        assert dict(quiet.values) == {"ns/blocking/gain": 2.0}
        with pytest.raises(TimeoutError):
            quiet.receive(0.01)
    assert list(quiet) == []
    with pytest.raises(TypeError, match="coroutine"):

        async def coroutine(values: Any) -> None: ...

        node.on_set_parameters(coroutine)
    node.delete_parameter("~gain")
    assert len(node.parameters) == 0


def test_what_others_set_is_judged_in_the_thread_that_spins(system: SystemManager) -> None:
    loop = BackgroundLoop()
    node = BlockingHandle()
    node.declare_parameter("~gain", 1.0)
    node.on_set_parameters(lambda values: values["~gain"] < 4)
    other = NodeHandle("other", master=node.master)
    loop.run(other.start())
    results: list[Any] = []

    async def set_both() -> None:
        await other.set_parameters({"ns/blocking/gain": 2})
        try:
            await other.set_parameters({"ns/blocking/gain": 5})
        except ParameterRefused as error:
            results.append(error.reason)

    loop.start(set_both())
    spin_until(system, lambda: results)
    assert "returned False" in results[0]
    assert node.parameters["~gain"] == 2.0
    loop.run(other.close())
    loop.stop()
