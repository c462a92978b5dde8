"""``simple-ros action`` as a user runs it."""

from __future__ import annotations

import asyncio
import json
import signal
from collections.abc import AsyncIterator
from types import SimpleNamespace
from typing import Any

import pytest
from google.protobuf import descriptor_pb2
from support.cli import PROGRAM, run, run_json
from support.processes import python
from support.waiting import until

from simple_ros.aio import ActionServer, NodeHandle, ServerGoal
from simple_ros.cli.completion import complete_actions
from simple_ros.msg.definitions import message_class
from simple_ros.msg.example_interfaces import (
    Fibonacci,
    FibonacciFeedback,
    FibonacciGoal,
    FibonacciResult,
)
from simple_ros.msg.interfaces import ActionType
from simple_ros_master import Master

Goal = ServerGoal[FibonacciGoal, FibonacciResult, FibonacciFeedback]


async def execute(goal: Goal) -> FibonacciResult:
    match goal.goal.order:
        case 0:
            raise ValueError("nothing to do")
        case 99:
            await asyncio.Event().wait()
    goal.publish_feedback(FibonacciFeedback(sequence=[1]))
    await asyncio.sleep(0)
    return FibonacciResult(sequence=[1, 2])


@pytest.fixture
async def server(master: Master) -> AsyncIterator[ActionServer[Any, Any, Any]]:
    async with NodeHandle("robot", master=master.address) as node:
        yield await node.advertise_action(
            "fibonacci", Fibonacci, execute, on_goal=lambda goal: goal.order >= 0
        )


async def test_list_and_info(master: Master, server: ActionServer[Any, Any, Any]) -> None:
    at = ("--master", master.address)
    client = server._node.action_client("fibonacci", Fibonacci)
    goal = await client.send_goal(FibonacciGoal(order=99))
    listed, none, as_json, shown, info = await asyncio.gather(
        run("action", "list", *at),
        run("action", "list", "nothing", *at),
        run_json("action", "list", *at),
        run("action", "info", "/fibonacci", *at),
        run_json("action", "info", "fibonacci", *at),
    )
    assert listed == (0, "fibonacci  example_interfaces.Fibonacci\n", "")
    assert none == (0, "", "")
    assert as_json[0]["action"] == "fibonacci"
    assert as_json[0]["goal"] == "example_interfaces.FibonacciGoal"
    assert shown[1].splitlines()[:7] == [
        "Action: fibonacci",
        "Type: example_interfaces.Fibonacci",
        "  goal      example_interfaces.FibonacciGoal",
        "  result    example_interfaces.FibonacciResult",
        "  feedback  example_interfaces.FibonacciFeedback",
        f"Server: robot  127.0.0.1:{server._node.port}",
        "Goals:",
    ]
    assert f"  {goal.goal_id.hex}  executing  accepted 20" in shown[1]
    assert [entry["status"] for entry in info["goals"]] == ["EXECUTING"]


async def test_send_goal(master: Master, server: ActionServer[Any, Any, Any]) -> None:
    at = ("--master", master.address)
    sent, quiet, aborted, rejected, bad, unknown = await asyncio.gather(
        run("action", "send-goal", "fibonacci", "{order: 3}", "--feedback", *at),
        run("action", "send-goal", "fibonacci", "order: 3", "--json", *at),
        run("action", "send-goal", "fibonacci", "{}", *at),
        run("action", "send-goal", "fibonacci", "{order: -1}", *at),
        run("action", "send-goal", "fibonacci", "{ordr: 1}", *at),
        run("action", "send-goal", "fibonaci", "{order: 1}", *at),
    )
    assert (sent[0], sent[2]) == (0, "")
    first, *rest = sent[1].splitlines()
    assert first.startswith("Goal ")
    assert first.endswith(" accepted")
    assert rest == [
        *("Feedback:", "  sequence: [1]"),
        *("Result:", "  sequence: [1, 2]"),
        "Goal succeeded",
    ]
    events = [json.loads(line) for line in quiet[1].splitlines()]
    assert [event["event"] for event in events] == ["accepted", "ended"]
    assert events[1] == {
        "event": "ended",
        "status": "SUCCEEDED",
        "result": {"sequence": [1, 2]},
        "error_type": "",
        "error": "",
    }
    assert aborted[0] == 1
    assert aborted[1].splitlines()[1:] == ["Goal aborted: ValueError: nothing to do"]
    assert rejected[:2] == (1, "")
    assert rejected[2].endswith("rejected (the server refuses it)\n")
    assert bad[0] == 2
    assert "no field 'ordr'" in bad[2]
    assert unknown == (1, "", "error: no action 'fibonaci'; did you mean 'fibonacci'?\n")


async def test_ctrl_c_cancels_the_goal_and_waits(
    master: Master, server: ActionServer[Any, Any, Any]
) -> None:
    words = ("action", "send-goal", "fibonacci", "{order: 99}", "--master", master.address)
    async with python(*PROGRAM, *words) as process:
        assert (await process.line()).endswith(" accepted")
        process.signal(signal.SIGINT)
        assert (await process.line()).startswith("Canceling the goal: Ctrl-C")
        assert await process.line() == "Goal canceled"
        assert await process.wait() == 130
        assert await process.errors() == ""
    assert server.goals == ()


async def test_a_second_ctrl_c_does_not_wait(master: Master) -> None:
    async def stubborn(goal: Goal) -> FibonacciResult:
        await asyncio.Event().wait()
        raise AssertionError

    words = ("action", "send-goal", "stubborn", "{order: 9}", "--master", master.address)
    async with NodeHandle("robot", master=master.address) as node:
        await node.advertise_action("stubborn", Fibonacci, stubborn, interrupt=False)
        async with python(*PROGRAM, *words) as process:
            assert (await process.line()).endswith(" accepted")
            process.signal(signal.SIGINT)
            await process.line()
            process.signal(signal.SIGINT)
            assert await process.wait() == 130


async def test_time_limits_result_and_cancel(
    master: Master, server: ActionServer[Any, Any, Any]
) -> None:
    at = ("--master", master.address)
    send = ("action", "send-goal", "fibonacci", "{order: 99}", *at)
    canceled, late = await asyncio.gather(
        run(*send, "--cancel-after", "0.01"), run(*send, "--timeout", "0.01")
    )
    assert canceled[0] == 130
    assert canceled[1].splitlines()[1:] == [
        "Canceling the goal: it takes longer than 0.01 s",
        "Goal canceled",
    ]
    (goal,) = server.goals
    number = goal.goal_id.hex
    assert late[0] == 1
    assert late[2].endswith(f"'simple-ros action result fibonacci {number}'\n")
    async with python(*PROGRAM, "action", "result", "fibonacci", number, *at) as waiting:
        await until(lambda: server._services[1].statistics.running == 1)
        code, stdout, _ = await run("action", "cancel", "fibonacci", number, *at)
        assert (code, stdout) == (0, f"canceling {number}\n")
        assert await waiting.line() == "Goal canceled"
        assert await waiting.wait() == 130
    again, all_of_none, both, no_id = await asyncio.gather(
        run("action", "cancel", "fibonacci", number, *at),
        run_json("action", "cancel", "fibonacci", "--all", *at),
        run("action", "cancel", "fibonacci", *at),
        run("action", "result", "fibonacci", "abc", *at),
    )
    assert again[:2] == (1, f"goal {number} had ended already\n")
    assert all_of_none == {"canceling": []}
    assert (both[0], no_id[0]) == (2, 2)


async def test_an_action_whose_types_are_unknown_here(master: Master) -> None:
    file = descriptor_pb2.FileDescriptorProto(name="lift.proto", package="lift", syntax="proto3")
    for part in ("Goal", "Result", "Feedback"):
        message = file.message_type.add(name=f"Lift{part}")
        message.field.add(
            name="height_m",
            number=1,
            type=descriptor_pb2.FieldDescriptorProto.TYPE_DOUBLE,
            label=descriptor_pb2.FieldDescriptorProto.LABEL_OPTIONAL,
        )
    files = descriptor_pb2.FileDescriptorSet(file=[file])
    classes = [message_class(files, f"lift.Lift{part}") for part in ("Goal", "Result", "Feedback")]
    lift: ActionType[Any, Any, Any] = ActionType(*classes)

    async def lifted(goal: ServerGoal[Any, Any, Any]) -> Any:
        goal.publish_feedback(classes[2](height_m=goal.goal.height_m / 2))
        return classes[1](height_m=goal.goal.height_m)

    at = ("--master", master.address)
    async with NodeHandle("robot", master=master.address) as node:
        await node.advertise_action("lift", lift, lifted)
        code, stdout, _ = await run("action", "send-goal", "lift", "{height_m: 2}", "-f", *at)
    assert code == 0
    assert stdout.splitlines()[1:] == [
        *("Feedback:", "  height_m: 1.0", "Result:", "  height_m: 2.0", "Goal succeeded"),
    ]


async def test_completion(master: Master, server: ActionServer[Any, Any, Any]) -> None:
    context: Any = SimpleNamespace(params={"master": master.address})
    names = await asyncio.to_thread(complete_actions, context, "/fib")
    assert names == ["/fibonacci"]
