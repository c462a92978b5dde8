"""``simple-ros param`` as a user runs it."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest
from support.cli import following, run, run_json
from support.waiting import until

from simple_ros.aio import NodeHandle
from simple_ros_master import Master


async def declared(node: NodeHandle) -> None:
    await node.declare_parameter("~gain", 1.0, minimum=0, maximum=5, description="How much")
    await node.declare_parameter("~mode", "slow", choices=("slow", "1"))
    await node.declare_parameter("~model", "x", read_only=True)


async def test_looking(master: Master) -> None:
    at = ("--master", master.address)
    async with NodeHandle("driver", master=master.address, namespace="robot1") as node:
        await declared(node)
        await node.set_parameters({"/ids": [1, 2], "/raw": b"\x00\xff"})
        listed, valued, one, group, described, dumped, wrong, asked = await asyncio.gather(
            run("param", "list", *at),
            run("param", "list", "/robot1", "--values", *at),
            run("param", "get", "/robot1/driver/gain", *at),
            run("param", "get", "robot1", *at),
            run("param", "describe", "robot1/driver", *at),
            run("param", "dump", *at),
            run("param", "get", "robot1/driver/gian", *at),
            run_json("param", "describe", "robot1/driver/gain", *at),
        )
        assert listed[1].split() == [
            "ids",
            "raw",
            "robot1/driver/gain",
            "robot1/driver/mode",
            "robot1/driver/model",
        ]
        assert valued[1].splitlines()[0] == "robot1/driver/gain   float   1.0"
        assert one == (0, "1.0\n", "")
        assert group[1] == "driver: {gain: 1.0, mode: slow, model: x}\n"
        assert described[1].split("\n\n")[0].splitlines() == [
            "Parameter: robot1/driver/gain",
            "Description: How much",
            "Type: float",
            "Value: 1.0 (default)",
            "Minimum: 0",
            "Maximum: 5",
            "Declared by: robot1/driver",
        ]
        assert "Choices: slow, '1'" in described[1]
        assert "Read-only" in described[1]
        assert "raw: !!binary 'AP8='\n" in dumped[1]
        assert wrong[0] == 1
        assert "did you mean 'robot1/driver/gain'" in wrong[2]
        assert asked["maximum"] == 5
        assert asked["nodes"] == ["robot1/driver"]


async def test_changing(master: Master) -> None:
    at = ("--master", master.address)
    async with NodeHandle("driver", master=master.address) as node:
        await declared(node)
        gain = "driver/gain"
        assert await run("param", "set", gain, "2", "driver/mode", "1", "x", "-5", *at) == (
            0,
            "",
            "",
        )
        # The node hears it beside the answer to the command.
        await until(lambda: (node.parameters["~gain"], node.parameters["~mode"]) == (2.0, "1"))
        assert await node.get_parameter("x") == -5
        cases: list[tuple[tuple[str, ...], int, str]] = [
            (("set", gain, "9"), 1, "9.0 is more than its maximum 5"),
            (("set", gain, "hot", "x", "1"), 1, "is declared float, but 'hot' is string"),
            (("set", gain, "[1,"), 1, "no YAML"),
            (("set", gain, "1", "x"), 2, "'x' has no value"),
            (("set", "a-b", "1"), 1, "must not contain '-'"),
            (("set", "driver/model", "y"), 1, "declares it read-only"),
            (("delete", "driver"), 1, "node 'driver' declares it and lives"),
            (("dump", "x"), 1, "is a parameter, not a group"),
            (("load", "/no/such.yaml"), 1, "No such file"),
        ]
        results = await asyncio.gather(*(run("param", *words, *at) for words, _, _ in cases))
        for (words, code, message), (found, _, errors) in zip(cases, results, strict=True):
            assert (found, message in " ".join(errors.split())) == (code, True), (words, errors)
        assert node.parameters["~gain"] == 2.0
        assert await run_json("param", "set", "pid", "{p: 1, i: 2.5}", *at) == {
            "pid/p": 1,
            "pid/i": 2.5,
        }
        assert await run_json("param", "get", "pid", *at) == {"p": 1, "i": 2.5}
        assert await run_json("param", "delete", "pid", "x", *at) == ["pid/i", "pid/p", "x"]


async def test_dump_and_load(master: Master, tmp_path: Path) -> None:
    at = ("--master", master.address)
    async with NodeHandle("tool", master=master.address) as node:
        values: dict[str, Any] = {"gain": 1.0, "ids": [1, 2], "pid": {"p": 0.5, "name": "yes"}}
        await node.set_parameters({"robot1": values})
        file = tmp_path / "robot.yaml"
        assert await run("param", "dump", "robot1", "-o", str(file), *at) == (0, "", "")
        assert await run("param", "load", str(file), "/robot2", *at) == (0, "", "")
        assert await node.get_parameter("robot2") == values
        file.write_text("gain: 1\nids: [1, x]\n")
        code, _, errors = await run("param", "load", str(file), *at)
        assert (code, "robot.yaml:2: parameter 'ids'" in errors) == (1, True)
        assert await run("param", "dump", "nothing", *at) == (0, "", "")


async def test_watching(master: Master) -> None:
    at = ("--master", master.address)
    async with NodeHandle("tool", master=master.address) as node:
        await node.set_parameters({"a/x": 1, "b": 1})
        async with following("param", "watch", "/a", *at) as watching:
            assert await watching.line() == "a/x: 1"
            await node.set_parameters({"a/x": "two words", "b": 2})
            assert await watching.line() == "a/x: two words"
            await node.delete_parameter("a/x")
            assert await watching.line() == "a/x is gone"
        code, stdout, _ = await run("param", "watch", "-n", "1", "--json", *at)
        assert (code, stdout) == (0, '{"name": "b", "value": 2, "previous": null}\n')


async def test_no_master() -> None:
    for command in ("list", "watch"):
        code, _, errors = await run("param", command, "--master", "127.0.0.1:1")
        assert (code, "no Master answers" in errors) == (1, True)


@pytest.mark.parametrize(("typed", "names"), [("dri", "driver/gain"), ("/dri", "/driver/gain")])
async def test_completion(master: Master, typed: str, names: str) -> None:
    async with NodeHandle("driver", master=master.address) as node:
        await node.declare_parameter("~gain", 1.0)
        # Who types does not wait for a Master that is slow: nothing is offered then, so try again.
        for _ in range(5):
            code, stdout, errors = await run(
                _SIMPLE_ROS_COMPLETE="complete_bash",
                COMP_WORDS=f"simple-ros param get {typed}",
                COMP_CWORD="3",
                SIMPLE_ROS_MASTER=master.address,
            )
            assert (code, errors) == (0, "")
            if stdout:
                break
        assert stdout.split() == [names]
