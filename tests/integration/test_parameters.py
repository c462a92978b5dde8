"""Parameters of nodes, with a real Master, its double and one of C++ simple_ros."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from typing import Any

import pytest
from support.foreign_master import ForeignMaster as CppMaster
from support.waiting import until

from simple_ros.aio import NodeHandle
from simple_ros.arguments import Arguments
from simple_ros.errors import HandleClosed, InvalidName, NodeNameTaken
from simple_ros.net.master_client import ForeignMaster, MasterClient
from simple_ros.parameters import desk, local
from simple_ros.parameters.calls import ParameterCalls
from simple_ros.parameters.errors import (
    ParameterConflict,
    ParameterError,
    ParameterOutOfRange,
    ParameterReadOnly,
    ParameterRefused,
    ParameterTypeMismatch,
    UnknownParameter,
)
from simple_ros.parameters.feed import ParameterChanged
from simple_ros.parameters.tree import Origin
from simple_ros.rpc import methods
from simple_ros.rpc import parameters_pb2 as par
from simple_ros.testing import FakeMaster
from simple_ros_master import Master


@pytest.fixture(params=["real", "double"])
async def anyone(request: pytest.FixtureRequest) -> AsyncIterator[Any]:
    """What nodes take as their Master."""
    if request.param == "double":
        yield FakeMaster()
        return
    async with Master(port=0) as running:
        yield running.address


def node(master: Any, name: str, words: str = "", **more: Any) -> NodeHandle:
    return NodeHandle(name, master=master, arguments=Arguments.parse(words), **more)


class TestDeclaring:
    async def test_declared_read_and_set(self, anyone: Any) -> None:
        async with (
            node(anyone, "driver", namespace="robot1") as driver,
            node(anyone, "tool") as tool,
        ):
            assert await driver.declare_parameter("~gain", 1.0, minimum=0, maximum=5) == 1.0
            assert await driver.declare_parameter("rate", 10) == 10
            assert await driver.declare_parameter("/global", "x") == "x"
            names = ["global", "robot1/driver/gain", "robot1/rate"]
            assert await tool.list_parameters() == names
            assert await driver.list_parameters("~") == ["robot1/driver/gain"]
            assert await tool.get_parameter("robot1") == {"driver": {"gain": 1.0}, "rate": 10}
            await tool.set_parameters({"robot1": {"driver": {"gain": 2}, "rate": 20}, "new": [1]})
            await until(lambda: driver.parameters["~gain"] == 2.0)
            assert dict(driver.parameters) == {"~gain": 2.0, "rate": 20, "/global": "x"}
            assert "~gain" in driver.parameters
            assert "gain" not in driver.parameters
            assert driver.parameters.get("gain") is None
            assert await driver.get_parameter("/new") == [1]
            info = await tool.describe_parameter("robot1/driver/gain")
            assert (info.nodes, info.origin) == (("robot1/driver",), Origin.SET)
            assert info.descriptor is not None
            assert (info.descriptor.type, info.descriptor.maximum) == ("float", 5)

    async def test_the_command_line_wins_over_the_master_over_the_default(
        self, anyone: Any
    ) -> None:
        async with node(anyone, "tool") as tool:
            await tool.set_parameters({"d": {"told": 1, "set": 2}})
            async with node(anyone, "d", "_told:=3") as d:
                assert await d.declare_parameter("~told", 0) == 3
                assert await d.declare_parameter("~set", 0.5) == 2.0
                assert await d.declare_parameter("~default", 7) == 7
                assert await d.declare_parameter("~told", 0) == 3
                with pytest.raises(ParameterConflict, match="otherwise"):
                    await d.declare_parameter("~told", 0, minimum=0)

    async def test_what_is_told_must_fit(self, master: Master) -> None:
        async with node(master.address, "d", "_gain:=hot _low:=-1") as d:
            with pytest.raises(
                ParameterTypeMismatch, match=r"'d/gain'.*float.*'hot'.*command line"
            ):
                await d.declare_parameter("~gain", 1.0)
            with pytest.raises(ParameterOutOfRange, match="minimum 0"):
                await d.declare_parameter("~low", 1, minimum=0)
            with pytest.raises(ParameterOutOfRange):
                await d.declare_parameter("~default", 1, maximum=0)
            with pytest.raises(InvalidName):
                await d.declare_parameter("~a b", 1)
            assert len(d.parameters) == 0
            assert await d.list_parameters() == []

    async def test_undeclared_but_told(self, master: Master) -> None:
        async with node(master.address, "d", "_x:=1") as d:
            assert await d.get_parameter("~x") == 1
            assert await d.has_parameter("~x")
            assert not await d.has_parameter("~y")
            assert await d.get_parameter("~y", None) is None
            with pytest.raises(UnknownParameter, match="'d/y'"):
                await d.get_parameter("~y")

    async def test_they_go_with_the_node(self, anyone: Any) -> None:
        async with node(anyone, "tool") as tool:
            async with node(anyone, "d") as d:
                await d.declare_parameter("~kept", 1)
                await d.declare_parameter("~gone", 1)
                await d.declare_parameter("~undeclared", 1)
                await d.delete_parameter("~undeclared")
                assert "~undeclared" not in d.parameters
                with pytest.raises(ParameterConflict):
                    await tool.delete_parameter("d/kept")
                await tool.set_parameters({"d/kept": 2})
                assert await tool.list_parameters() == ["d/gone", "d/kept"]
            # A node that cannot say goodbye at once just leaves; its Master notices a moment later.
            while "d/gone" in await tool.list_parameters():
                pass
            assert await tool.list_parameters() == ["d/kept"]
            await tool.delete_parameter("d/kept")
            assert await tool.list_parameters() == []

    async def test_a_newer_node_takes_them_over(self, master: Master) -> None:
        async with node(master.address, "d") as older, node(master.address, "tool") as tool:
            await older.declare_parameter("~x", 1, maximum=1)
            async with node(master.address, "d") as newer:
                assert await newer.declare_parameter("~x", 2) == 2
                await older.wait_ended()
                with pytest.raises(NodeNameTaken):
                    await older.declare_parameter("~y", 1)
                await tool.set_parameters({"d/x": 3})
                await until(lambda: newer.parameters["~x"] == 3)
                assert older.parameters["~x"] == 1

    async def test_only_of_a_node_that_runs(self, master: Master) -> None:
        d = node(master.address, "d")
        with pytest.raises(RuntimeError, match="not started"):
            await d.declare_parameter("~x", 1)
        async with d:
            await d.declare_parameter("~x", 1)
            watch = await d.watch_parameters()
        with pytest.raises(HandleClosed):
            await d.declare_parameter("~y", 1)
        assert [change async for change in watch] == []
        with pytest.raises(HandleClosed):
            await watch.receive()

    async def test_only_with_a_lease(self, master: Master) -> None:
        async with MasterClient(master.address) as client:
            item = par.ParameterDeclaration(parameter=par.Parameter(name="x"))
            item.parameter.value.int_value = 1
            request = par.DeclareParametersRequest(declarations=[item])
            answer = await client.call(methods.DECLARE_PARAMETERS, request)
            assert "holds no lease" in answer.problem.reason


class TestSetting:
    async def test_a_refused_group_changes_nothing_at_anybody(self, anyone: Any) -> None:
        async with node(anyone, "a") as a, node(anyone, "b") as b, node(anyone, "tool") as tool:
            await a.declare_parameter("~x", 1)
            await b.declare_parameter("~x", 1)
            asked: list[dict[str, Any]] = []

            async def judge(values: dict[str, Any]) -> str | None:
                await asyncio.sleep(0)
                return "too much" if values["~x"] > 5 else None

            a.on_set_parameters(lambda values: asked.append(values))
            b.on_set_parameters(judge)
            with pytest.raises(ParameterRefused, match=r"'b/x': node 'b' refuses: too much"):
                await tool.set_parameters({"a/x": 2, "b/x": 6, "free": 1})
            assert asked == [{"~x": 2}]
            assert await tool.get_parameter("a") == {"x": 1}
            assert not await tool.has_parameter("free")
            await tool.set_parameters({"a/x": 2, "b/x": 5, "free": 1})
            await until(lambda: (a.parameters["~x"], b.parameters["~x"]) == (2, 5))
            with pytest.raises(ParameterTypeMismatch):
                await tool.set_parameters({"a/x": 3, "b/x": "5"})
            assert len(asked) == 2

    @pytest.mark.parametrize(
        ("callback", "reason"),
        [
            (lambda values: False, "returned False"),
            (lambda values: "no", "refuses: no"),
            (lambda values: {}["nothing"], "refuses: 'nothing'"),
        ],
    )
    async def test_ways_to_refuse(self, anyone: Any, callback: Any, reason: str) -> None:
        async with node(anyone, "a") as a, node(anyone, "tool") as tool:
            await a.declare_parameter("~x", 1)
            a.on_set_parameters(lambda values: True)
            a.on_set_parameters(callback)
            for who, name in ((tool, "a/x"), (a, "~x")):
                with pytest.raises(ParameterRefused, match=reason):
                    await who.set_parameters({name: 2, "other": 1})
            assert a.parameters["~x"] == 1
            await tool.set_parameters({"other": 1})

    async def test_own_ones_are_set_when_the_call_returns(self, anyone: Any) -> None:
        async with node(anyone, "a") as a:
            await a.declare_parameter("~x", 1)
            await a.declare_parameter("~fixed", 1, read_only=True)
            seen: list[Any] = []
            a.on_parameter_changed("~x", seen.append)
            await a.set_parameters({"~x": 2})
            assert a.parameters["~x"] == await a.get_parameter("a/x") == 2
            with pytest.raises(ParameterReadOnly):
                await a.set_parameters({"~x": 3, "~fixed": 2})
            await a.set_parameters({"~x": 4})
            assert seen == [1, 2, 4]

    async def test_hooks(self, anyone: Any) -> None:
        async with node(anyone, "a") as a, node(anyone, "tool") as tool:
            seen: list[Any] = []
            arrived = asyncio.Event()

            async def later(value: Any) -> None:
                seen.append(("later", value))
                arrived.set()

            a.on_parameter_changed("~x", seen.append)
            a.on_parameter_changed("~x", lambda value: 1 / 0)
            a.on_parameter_changed("~x", later)
            await a.declare_parameter("~x", 1)
            await arrived.wait()
            await tool.set_parameters({"a/x": 1})
            await tool.set_parameters({"a/x": 2})
            await until(lambda: len(seen) == 4)
            assert seen == [1, ("later", 1), 2, ("later", 2)]

    @pytest.mark.parametrize("patient", [True, False])
    async def test_a_node_that_does_not_answer(
        self, master: Master, monkeypatch: pytest.MonkeyPatch, patient: bool
    ) -> None:
        monkeypatch.setattr(desk, "ANSWER_WITHIN_S", 5 if patient else 0.05)
        monkeypatch.setattr(local, "_THINK_S", 0.05 if patient else 5)
        async with node(master.address, "a") as a, node(master.address, "tool") as tool:
            await a.declare_parameter("~x", 1)

            async def never(values: dict[str, Any]) -> None:
                await asyncio.Event().wait()

            a.on_set_parameters(never)
            reason = "no answer within" if patient else "did not answer within"
            with pytest.raises(ParameterRefused, match=reason):
                await tool.set_parameters({"a/x": 2})
            assert await tool.get_parameter("a/x") == 1

    async def test_a_node_that_dies_while_it_is_asked(self, master: Master) -> None:
        async with node(master.address, "tool") as tool:
            async with node(master.address, "a") as a:
                await a.declare_parameter("~x", 1)
                asked = asyncio.Event()

                async def never(values: dict[str, Any]) -> None:
                    asked.set()
                    await asyncio.Event().wait()

                a.on_set_parameters(never)
                setting = asyncio.create_task(tool.set_parameters({"a/x": 2}))
                await asked.wait()
            await setting
            assert await tool.get_parameter("a/x") == 2

    async def test_one_global_parameter_of_several_nodes(self, anyone: Any) -> None:
        async with node(anyone, "a") as a, node(anyone, "b") as b:
            await a.declare_parameter("/speed", 1.0, maximum=5)
            assert await b.declare_parameter("speed", 3.0) == 1.0
            b.on_set_parameters(lambda values: values["speed"] != 4)
            with pytest.raises(ParameterRefused):
                await a.set_parameters({"speed": 4})
            await b.set_parameters({"speed": 2})
            await until(lambda: a.parameters["/speed"] == 2.0)

    async def test_many_at_once(self, anyone: Any) -> None:
        async with node(anyone, "a") as a, node(anyone, "tool") as tool:
            await a.declare_parameter("~x", 0)
            setters = [who.set_parameters({"a/x": n}) for n in range(20) for who in (a, tool)]
            await asyncio.gather(*setters)
            last = await tool.get_parameter("a/x")
            await until(lambda: a.parameters["~x"] == last)


class TestWatching:
    async def test_what_is_there_then_every_change(self, anyone: Any) -> None:
        async with node(anyone, "a", namespace="ns") as a:
            await a.set_parameters({"x": 1, "/other": 1})
            watch = await a.watch_parameters("/ns")
            assert await watch.receive(30) == ParameterChanged("ns/x", 1, None)
            await a.set_parameters({"x": 2, "/other": 2, "~y": 3})
            assert await watch.receive(30) == ParameterChanged("ns/x", 2, 1)
            assert await watch.receive(30) == ParameterChanged("ns/a/y", 3, None)
            await a.delete_parameter("x")
            assert await watch.receive(30) == ParameterChanged("ns/x", None, 2)
            assert dict(watch.values) == {"ns/a/y": 3}
            await watch.close()
            await watch.close()

    async def test_changes_that_nobody_takes_are_joined(self, anyone: Any) -> None:
        async with node(anyone, "a") as a, await a.watch_parameters("x") as watch:
            for value in range(5):
                await a.set_parameters({"x": value, "y": value})
            await until(lambda: watch.values.get("x") == 4)
            assert await watch.receive() == ParameterChanged("x", 4, None)
            with pytest.raises(TimeoutError):
                await watch.receive(0.01)

    async def test_callbacks(self, anyone: Any) -> None:
        async with node(anyone, "a") as a:
            plain: list[Any] = []
            awaited: list[Any] = []

            async def later(change: ParameterChanged) -> None:
                await asyncio.sleep(0)
                awaited.append(change.value)

            async with (
                await a.watch_parameters("", lambda change: plain.append(change.value)),
                await a.watch_parameters("", later),
                await a.watch_parameters("", lambda change: 1 / 0) as bad,
            ):
                await a.set_parameters({"x": 1})
                await until(lambda: plain == awaited == [1])
                await until(lambda: bad.errors == 1)


async def test_outages_of_the_double() -> None:
    fake = FakeMaster()
    async with node(fake, "a") as a, node(fake, "tool") as tool:
        await a.declare_parameter("~x", 1)
        await tool.set_parameters({"a/x": 5, "free": 1})
        watch = await tool.watch_parameters()
        await until(lambda: dict(watch.values) == {"a/x": 5, "free": 1})
        with fake.outage():
            assert a.parameters["~x"] == 5
        await until(lambda: dict(watch.values) == {"a/x": 5})
        assert fake.parameters.values() == {"a/x": 5}
        await tool.set_parameters({"a/x": 6})
        await until(lambda: a.parameters["~x"] == 6)


async def test_with_a_cpp_master_own_parameters_are_kept_here() -> None:
    async with CppMaster() as cpp, node(cpp.address, "a", "_told:=3") as a:
        assert await a.declare_parameter("~told", 1.0) == 3.0
        assert await a.declare_parameter("~x", 1, maximum=5) == 1
        seen: list[Any] = []
        a.on_parameter_changed("~x", seen.append)
        a.on_set_parameters(lambda values: values["~x"] != 4)
        await a.set_parameters({"~x": 2})
        assert await a.get_parameter("~x") == 2
        assert seen == [1, 2]
        assert (await a.describe_parameter("~x")).value == 2
        for values, error in (
            ({"~x": 6}, ParameterOutOfRange),
            ({"~x": 4}, ParameterRefused),
            ({"~x": 3, "other": 1}, ForeignMaster),
        ):
            with pytest.raises(error):
                await a.set_parameters(values)
        assert a.parameters["~x"] == 2
        for call in (
            a.get_parameter("other"),
            a.list_parameters(),
            a.watch_parameters(),
            a.delete_parameter("other"),
            a.describe_parameter("other"),
        ):
            with pytest.raises(ForeignMaster, match="C\\+\\+"):
                await call
        await a.delete_parameter("~x")
        assert "~x" not in a.parameters


async def test_a_request_from_elsewhere_that_makes_no_sense(master: Master) -> None:
    async with MasterClient(master.address) as client:
        empty = par.SetParametersRequest(parameters=[par.Parameter(name="x")])
        assert (await client.call(methods.SET_PARAMETERS, empty)).problem.reason
        bad = par.Parameter(name="a b", value=par.ParameterValue(int_value=1))
        answer = await client.call(
            methods.SET_PARAMETERS, par.SetParametersRequest(parameters=[bad])
        )
        assert answer.problem.kind == "InvalidName"
        with pytest.raises(ParameterError, match="must not contain"):
            await ParameterCalls(client).set({"a b": 1})
        with pytest.raises(UnknownParameter):
            await ParameterCalls(client).describe("nothing")
        assert list(await ParameterCalls(client).describe()) == []
        assert len(master.parameters) == 0
