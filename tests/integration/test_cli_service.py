"""``simple-ros service`` as a user runs it."""

from __future__ import annotations

import asyncio
import json
import signal
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
from support.cli import PROGRAM, following, run, run_json
from support.processes import master_process, program, python
from support.waiting import until

from simple_ros.aio import NodeHandle
from simple_ros.cli.service.lookup import UnknownServiceType, is_hidden, resolve_service_type
from simple_ros.msg.example_interfaces import AddTwoInts, AddTwoIntsRequest, AddTwoIntsResponse
from simple_ros.msg.std_srvs import SetBool, Trigger, TriggerRequest, TriggerResponse
from simple_ros_master import Master

LAB = """
syntax = "proto3";
package lab;
message AskRequest { string question = 1; repeated int32 numbers = 2; }
message Reply { string answer = 1; }
"""
LAB_NODE = """
    import sys
    sys.path.insert(0, sys.argv[1])
    from lab_pb2 import AskRequest, Reply
    from simple_ros import aio

    async def main():
        async with aio.NodeHandle("oracle") as node:
            answer = lambda request: Reply(answer=f"{request.question} {sum(request.numbers)}")
            await node.advertise_service("ask", (AskRequest, Reply), answer)
            print("ready", flush=True)
            await node.spin()

    aio.run(main())
"""


def added(request: AddTwoIntsRequest) -> AddTwoIntsResponse:
    if request.a < 0:
        raise ValueError("not\nnegative")
    return AddTwoIntsResponse(sum=request.a + request.b)


@pytest.fixture
async def node(master: Master) -> AsyncIterator[NodeHandle]:
    async with NodeHandle("robot", master=master.address) as node:
        await node.advertise_service("add", AddTwoInts, added)
        await node.advertise_service("arm/lights", SetBool, lambda _: SetBool.response())
        await node.advertise_service("arm/_action/go", Trigger, lambda _: TriggerResponse())
        yield node


class TestLooking:
    async def test_list_info_type_find(self, master: Master, node: NodeHandle) -> None:
        at = ("--master", master.address)
        listed, everything, some, info, kind, found, near, wrong, none = await asyncio.gather(
            run("service", "list", *at),
            run("service", "list", "--all", *at),
            run("service", "list", "/arm", *at),
            run("service", "info", "/add", *at),
            run("service", "type", "add", *at),
            run("service", "find", "std_srvs/srv/SetBool", *at),
            run("service", "info", "lights", *at),
            run("service", "find", "SetBol", *at),
            run("service", "find", "Empty", *at),
        )
        add = "add         example_interfaces.AddTwoInts  robot\n"
        lights = "arm/lights  std_srvs.SetBool               robot\n"
        assert listed == (0, add + lights, "")
        assert everything[1].count("\n") == 3
        assert some == (0, "arm/lights  std_srvs.SetBool  robot\n", "")
        assert (info[0], info[1].splitlines(), info[2]) == (
            0,
            [
                "Service: add",
                "Type: example_interfaces.AddTwoInts",
                "Request: example_interfaces.AddTwoIntsRequest",
                "Response: example_interfaces.AddTwoIntsResponse",
                f"Node: robot  127.0.0.1:{node.port}",
            ],
            "",
        )
        assert kind == (0, "example_interfaces.AddTwoInts\n", "")
        assert found == (0, "arm/lights\n", "")
        assert near == (1, "", "error: no service 'lights'; did you mean 'arm/lights'?\n")
        expected = "error: no service type 'SetBol'; did you mean 'std_srvs.SetBool'?\n"
        assert wrong == (1, "", expected)
        assert none == (0, "", "")

    async def test_json(self, master: Master, node: NodeHandle) -> None:
        at = ("--master", master.address)
        listed, info, kind, found = await asyncio.gather(
            run_json("service", "list", *at),
            run_json("service", "info", "add", *at),
            run_json("service", "type", "add", *at),
            run_json("service", "find", "SetBool", *at),
        )
        assert [entry["service"] for entry in listed] == ["add", "arm/lights"]
        assert info == listed[0]
        assert (info["node"]["name"], info["node"]["port"]) == ("robot", node.port)
        assert kind == info["type"] == "example_interfaces.AddTwoInts"
        assert found == ["arm/lights"]

    async def test_completion(self, master: Master, node: NodeHandle) -> None:
        code, stdout, stderr = await run(
            _SIMPLE_ROS_COMPLETE="complete_bash",
            COMP_WORDS="simple-ros service call /ar",
            COMP_CWORD="3",
            SIMPLE_ROS_MASTER=master.address,
        )
        assert (code, stdout.split(), stderr) == (0, ["/arm/_action/go", "/arm/lights"], "")

    async def test_a_bad_name_is_shown_with_a_caret(self, master: Master) -> None:
        at = ("--master", master.address)
        service, action, topic, there = await asyncio.gather(
            run("service", "call", "a-b", *at),
            run("action", "info", "a-b", *at),
            run("topic", "info", "a-b", *at),
            run("node", "info", "a-b", *at),
        )
        for kind, told in zip(
            ("service", "action", "topic", "node"), (service, action, topic, there), strict=True
        ):
            assert (told[0], told[1]) == (1, "")
            assert told[2].startswith(f"error: {kind} name must not contain '-'")
            assert told[2].endswith("\n  'a-b'\n    ^\n")

    async def test_without_a_master(self) -> None:
        code, stdout, stderr = await run("service", "list", "--master", "127.0.0.1:1")
        assert (code, stdout) == (1, "")
        assert stderr.startswith("error: no Master answers at 127.0.0.1:1")


class TestCall:
    async def test_answers_and_errors(self, master: Master, node: NodeHandle) -> None:
        at = ("--master", master.address)
        answer, as_json, failed, bad_field, unknown = await asyncio.gather(
            run("service", "call", "/add", "{a: 1, b: 2}", *at),
            run_json("service", "call", "add", '{"a": 1, "b": 2}', *at),
            run("service", "call", "add", "a: -1", *at),
            run("service", "call", "add", "{c: 1}", *at),
            run("service", "call", "ad", *at),
        )
        assert answer == (0, "sum: 3\n", "")
        assert as_json == {"sum": "3"}
        reason = "service 'add': node 'robot' raised ValueError: not negative"
        assert failed == (1, "", f"error: {reason}\n")
        assert bad_field[0] == 1
        assert "has no field 'c'; its fields are a, b" in bad_field[2]
        assert unknown == (1, "", "error: no service 'ad'; did you mean 'add'?\n")

    async def test_again_and_again_with_times(self, master: Master, node: NodeHandle) -> None:
        at = ("--master", master.address)
        several, as_json, failing = await asyncio.gather(
            run("service", "call", "add", "{a: 2}", "-n", "2", "--time", *at),
            run("service", "call", "add", "-n", "2", "--rate", "50", "--time", "--json", *at),
            run("service", "call", "add", "a: -1", "-n", "2", *at),
        )
        code, stdout, stderr = several
        assert (code, stderr) == (0, "")
        first, took, line, *_, summary = stdout.splitlines()
        assert (first, line) == ("sum: 2", "---")
        assert took.startswith("# ")
        assert took.endswith(" ms")
        assert summary.startswith("# 2 of 2 answered: mean ")
        answers = [json.loads(text) for text in as_json[1].splitlines()]
        assert [answer["response"] for answer in answers] == [{"sum": "0"}] * 2
        assert all(answer["ms"] > 0 for answer in answers)
        assert (failing[0], failing[2].count("error: service 'add'")) == (1, 2)

    async def test_until_ctrl_c(self, master: Master, node: NodeHandle) -> None:
        words = ("service", "call", "add", "{b: 5}", "--rate", "100", "--master", master.address)
        async with following(*words) as process:
            assert [await process.line() for _ in range(4)] == ["sum: 5", "---"] * 2

    async def test_a_call_takes_no_longer_than_allowed(
        self, master: Master, node: NodeHandle
    ) -> None:
        async def never(request: TriggerRequest) -> TriggerResponse:
            await asyncio.Event().wait()
            return TriggerResponse()

        provided = await node.advertise_service("never", Trigger, never)
        words = ("service", "call", "never", "--master", master.address)
        code, _, stderr = await run(*words, "--timeout", "0.2")
        # Which side sees it first is a matter of luck.
        told = ("no answer from node 'robot' in time", "the provider gave up: its time was over")
        assert code == 1
        assert stderr in [f"error: service 'never': {reason}\n" for reason in told]
        await until(lambda: provided.statistics.running == 0, "the end of the first call")
        async with python(*PROGRAM, *words) as process:
            await until(lambda: provided.statistics.running == 1)
            process.signal(signal.SIGINT)
            assert await process.wait() == 130
            assert await process.errors() == ""
        await until(lambda: provided.statistics.running == 0, "the call to be taken back")

    async def test_a_type_never_seen_here(self, tmp_path: Path) -> None:
        pytest.importorskip("grpc_tools")
        (tmp_path / "lab.proto").write_text(LAB)
        compiled = await run("msg", "compile", str(tmp_path / "lab.proto"), "-o", str(tmp_path))
        assert compiled[0] == 0
        async with (
            master_process() as (_, address),
            program(LAB_NODE, str(tmp_path), master=address) as oracle,
        ):
            assert await oracle.line() == "ready"
            request = "{question: how much, numbers: [40, 2]}"
            at = ("--master", address)
            assert await run("service", "call", "ask", request, *at) == (
                0,
                'answer: "how much 42"\n',
                "",
            )
            assert await run("service", "type", "ask", *at) == (
                0,
                "lab.AskRequest -> lab.Reply\n",
                "",
            )
            found = await run("service", "find", "lab.AskRequest -> lab.Reply", *at)
            assert found == (0, "ask\n", "")


class TestNames:
    TYPES = ("std_srvs.SetBool", "std_srvs.Trigger", "mine.Trigger", "a.B -> c.D")

    @pytest.mark.parametrize(
        "spelling", ["std_srvs.SetBool", "std_srvs/SetBool", "std_srvs/srv/SetBool", "SetBool"]
    )
    def test_a_type_in_any_spelling(self, spelling: str) -> None:
        assert resolve_service_type(spelling, self.TYPES) == "std_srvs.SetBool"

    def test_two_messages(self) -> None:
        assert resolve_service_type("a.B -> c.D", self.TYPES) == "a.B -> c.D"

    def test_more_than_one_is_meant(self) -> None:
        with pytest.raises(UnknownServiceType) as caught:
            resolve_service_type("Trigger", self.TYPES)
        assert caught.value.near == ("mine.Trigger", "std_srvs.Trigger")

    def test_services_of_actions_are_hidden(self) -> None:
        assert is_hidden("fib/_action/send_goal")
        assert not is_hidden("arm_left/lights")
