"""Actions on one loop: goals, feedback, results, cancels and policies."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from typing import Any
from uuid import uuid4

import pytest
from support.foreign_master import ForeignMaster as CppMaster
from support.waiting import until

from simple_ros import (
    ActionServerLost,
    CancelRejected,
    ConfigError,
    GoalAborted,
    GoalCanceled,
    GoalRejected,
    GoalState,
    HandleClosed,
    InvalidGoalTransition,
    RegistrationRefused,
    ServiceTimeout,
    ServiceTypeMismatch,
    ServiceUnavailable,
    UnknownGoal,
)
from simple_ros.aio import ActionClient, ActionServer, ClientGoal, NodeHandle, ServerGoal
from simple_ros.msg.action_msgs import GoalStatusArray
from simple_ros.msg.example import Heartbeat, SensorData
from simple_ros.msg.example_interfaces import (
    Fibonacci,
    FibonacciFeedback,
    FibonacciGoal,
    FibonacciResult,
)
from simple_ros.msg.interfaces import ActionType
from simple_ros.net.master_client import ForeignMaster
from simple_ros.qos import LATCHED
from simple_ros.testing import FakeMaster
from simple_ros_master import Master

Goal = ServerGoal[FibonacciGoal, FibonacciResult, FibonacciFeedback]
Client = ActionClient[FibonacciGoal, FibonacciResult, FibonacciFeedback]


async def fibonacci(goal: Goal) -> FibonacciResult:
    sequence = [0, 1]
    while len(sequence) < goal.goal.order:
        sequence.append(sequence[-1] + sequence[-2])
        goal.publish_feedback(FibonacciFeedback(sequence=sequence))
        await asyncio.sleep(0)
    return FibonacciResult(sequence=sequence)


async def for_ever(goal: Goal) -> FibonacciResult:
    await asyncio.Event().wait()
    raise AssertionError


def order(number: int) -> FibonacciGoal:
    return FibonacciGoal(order=number)


@contextlib.asynccontextmanager
async def nodes(master: Master, where: str = "connected") -> AsyncIterator[tuple[Any, Any]]:
    """A server's node and a client's: on one loop directly, or with connections between them."""
    transports = ("tcp",) if where == "connected" else None
    async with (
        NodeHandle("server", master=master.address, transports=transports) as server,
        NodeHandle("client", master=master.address, transports=transports) as client,
    ):
        if where == "connected":
            client.providers._local_lanes = lambda _: None
        yield server, client


both_ways = pytest.mark.parametrize("where", ["local", "connected"])


@both_ways
async def test_goal_feedback_and_result(master: Master, where: str) -> None:
    async with nodes(master, where) as (server, node):
        await server.advertise_action("/fibonacci", Fibonacci, fibonacci)
        client = node.action_client("fibonacci", "example_interfaces/action/Fibonacci")
        got: list[list[int]] = []
        goal = await client.send_goal(order(5), feedback=lambda m: got.append(list(m.sequence)))
        assert list((await goal.result()).sequence) == [0, 1, 1, 2, 3]
        assert got == [[0, 1, 1], [0, 1, 1, 2], [0, 1, 1, 2, 3]]
        assert goal.status is GoalState.SUCCEEDED
        assert list((await goal.result()).sequence) == [0, 1, 1, 2, 3]


@both_ways
async def test_feedback_by_iteration_ends_with_the_goal(master: Master, where: str) -> None:
    async with nodes(master, where) as (server, node):
        await server.advertise_action("fibonacci", Fibonacci, fibonacci)
        client = node.action_client("fibonacci", Fibonacci)
        goal = await client.send_goal(order(6))
        assert [len(feedback.sequence) async for feedback in goal] == [3, 4, 5, 6]
        assert goal.status is GoalState.SUCCEEDED
        with pytest.raises(TypeError, match="async for"):
            await client.send_goal(order(3), feedback=fibonacci)


async def test_an_exception_aborts_and_is_seen_by_the_client(master: Master) -> None:
    async def fails(goal: Goal) -> FibonacciResult | None:
        match goal.goal.order:
            case 0:
                raise LookupError("no such order")
            case 1:
                goal.abort(FibonacciResult(sequence=[7]), "out of numbers")
                with pytest.raises(InvalidGoalTransition):
                    goal.publish_feedback(FibonacciFeedback())
                return None
            case 2:
                return None
            case _:
                return SensorData()  # type: ignore[return-value]

    async with nodes(master) as (server, node):
        await server.advertise_action("fails", Fibonacci, fails)
        client: Client = node.action_client("fails", Fibonacci)

        async def error_of(number: int) -> GoalAborted:
            with pytest.raises(GoalAborted) as caught:
                await (await client.send_goal(order(number))).result()
            return caught.value

        raised = await error_of(0)
        assert (raised.type, raised.message) == ("LookupError", "no such order")
        assert raised.reason == "aborted (LookupError: no such order)"
        aborted = await error_of(1)
        assert (aborted.type, aborted.message) == ("", "out of numbers")
        assert aborted.result == FibonacciResult(sequence=[7])
        assert "returned nothing" in (await error_of(2)).message
        assert "not example.SensorData" in (await error_of(3)).message


async def test_plain_functions_run_on_the_loop(master: Master) -> None:
    def at_once(goal: Goal) -> FibonacciResult:
        return FibonacciResult(sequence=[goal.goal.order])

    async with nodes(master) as (server, node):
        await server.advertise_action("plain", Fibonacci, at_once)
        goal = await node.action_client("plain", Fibonacci).send_goal(order(3))
        assert await goal.result() == FibonacciResult(sequence=[3])


class TestCancel:
    async def test_it_comes_out_of_what_execute_awaits(self, master: Master) -> None:
        async def partial(goal: Goal) -> FibonacciResult:
            try:
                return await for_ever(goal)
            except asyncio.CancelledError:
                if goal.goal.order:
                    goal.canceled(FibonacciResult(sequence=[1]), "as you wish")
                raise

        async with nodes(master) as (server, node):
            await server.advertise_action("long", Fibonacci, partial)
            client = node.action_client("long", Fibonacci)
            for number in (0, 1):
                goal = await client.send_goal(order(number))
                await until(lambda goal=goal: goal.status is GoalState.EXECUTING)
                assert await goal.cancel()
                with pytest.raises(GoalCanceled) as caught:
                    await goal.result()
                assert list(caught.value.result.sequence) == [1] * number  # type: ignore[attr-defined]
                assert caught.value.message == ("as you wish" if number else "")
                assert goal.status is GoalState.CANCELED
                assert not await goal.cancel()

    async def test_a_server_may_handle_it_itself(self, master: Master) -> None:
        async def polite(goal: Goal) -> FibonacciResult | None:
            await goal.wait_cancel_requested()
            assert goal.is_cancel_requested
            assert goal.state is GoalState.CANCELING
            if goal.goal.order:
                return FibonacciResult(sequence=[5])  # it was done after all
            goal.canceled()
            return None

        async with nodes(master) as (server, node):
            await server.advertise_action("polite", Fibonacci, polite, interrupt=False)
            client = node.action_client("polite", Fibonacci)
            one, other = [await client.send_goal(order(number)) for number in (0, 1)]
            assert await one.cancel()
            assert await other.cancel()
            assert (await one.outcome()).state is GoalState.CANCELED
            assert list((await other.result()).sequence) == [5]

    async def test_a_server_may_refuse(self, master: Master) -> None:
        asked: list[int] = []

        async def never(goal: Goal) -> bool:
            asked.append(goal.goal.order)
            return False

        async with nodes(master) as (server, node):
            await server.advertise_action("stubborn", Fibonacci, for_ever, on_cancel=never)
            client = node.action_client("stubborn", Fibonacci)
            goal = await client.send_goal(order(4))
            with pytest.raises(CancelRejected):
                await goal.cancel()
            with pytest.raises(CancelRejected):
                await client.cancel_all()
            assert asked == [4, 4]
            with pytest.raises(UnknownGoal):
                await client.goal(uuid4()).cancel()

    async def test_all_or_all_before_a_time(self, master: Master) -> None:
        async with nodes(master) as (server, node):
            await server.advertise_action("long", Fibonacci, for_ever)
            client = node.action_client("long", Fibonacci)
            goals = [await client.send_goal(order(number)) for number in range(4)]
            records = {goal.goal_id: goal._record for goal in server_goals(server)}
            until_second = records[goals[1].goal_id].stamp_ns / 1e9 + 1e-6
            first_two = [goal.goal_id for goal in goals[:2]]
            assert await client.cancel_all(until_second) == first_two
            assert await client.cancel_all() == [goal.goal_id for goal in goals[2:]]
            outcomes = await asyncio.gather(*(goal.outcome() for goal in goals))
            assert {outcome.state for outcome in outcomes} == {GoalState.CANCELED}
            assert await client.cancel_all() == []

    async def test_it_may_race_with_success(self, master: Master) -> None:
        """Whoever comes first: both sides agree, and a goal ends once."""
        async with nodes(master) as (server, node):
            served = await server.advertise_action("quick", Fibonacci, fibonacci)
            client = node.action_client("quick", Fibonacci)

            async def race(number: int) -> tuple[bool, GoalState]:
                goal = await client.send_goal(order(number % 20 + 2))
                ending = asyncio.ensure_future(goal.outcome())
                for _ in range(number % 7):
                    await asyncio.sleep(0)
                canceled = await goal.cancel()
                return canceled, (await ending).state

            for canceled, state in await asyncio.gather(*map(race, range(60))):
                assert state in (GoalState.SUCCEEDED, GoalState.CANCELED)
                assert canceled or state is GoalState.SUCCEEDED
            assert served.goals == ()


def server_goals(node: NodeHandle) -> tuple[Goal, ...]:
    (server,) = node.action_handles
    assert isinstance(server, ActionServer)
    return server.goals


class TestPolicies:
    @staticmethod
    @contextlib.asynccontextmanager
    async def gated(
        master: Master, policy: str
    ) -> AsyncIterator[tuple[Client, list[int], asyncio.Event]]:
        """A client of an action whose goals begin in order and wait for a gate."""
        begun: list[int] = []
        gate = asyncio.Event()

        async def execute(goal: Goal) -> FibonacciResult:
            begun.append(goal.goal.order)
            await gate.wait()
            return FibonacciResult(sequence=[goal.goal.order])

        async with nodes(master) as (server, node):
            await server.advertise_action("gated", Fibonacci, execute, policy=policy)
            yield node.action_client("gated", Fibonacci), begun, gate

    async def test_preempt(self, master: Master) -> None:
        async with self.gated(master, "preempt") as (client, begun, gate):
            first = await client.send_goal(order(1))
            second = await client.send_goal(order(2))
            with pytest.raises(GoalCanceled) as caught:
                await first.result()
            assert caught.value.message == f"preempted by goal {second.goal_id.hex}"
            await until(lambda: begun == [1, 2])
            gate.set()
            assert list((await second.result()).sequence) == [2]

    async def test_queue(self, master: Master) -> None:
        async with self.gated(master, "queue") as (client, begun, gate):
            goals = [await client.send_goal(order(number)) for number in (1, 2, 3)]
            await until(lambda: goals[0].status is GoalState.EXECUTING)
            assert goals[1].status is GoalState.ACCEPTED
            assert await goals[1].cancel()
            assert (await goals[1].outcome()).state is GoalState.CANCELED
            assert begun == [1]
            gate.set()
            assert [list((await goal.result()).sequence) for goal in goals[::2]] == [[1], [3]]
            assert begun == [1, 3]

    async def test_reject(self, master: Master) -> None:
        async with self.gated(master, "reject") as (client, _, gate):
            first = await client.send_goal(order(1))
            with pytest.raises(GoalRejected, match=first.goal_id.hex):
                await client.send_goal(order(2))
            gate.set()
            await first.result()
            await (await client.send_goal(order(3))).result()

    async def test_200_goals_in_parallel(self, master: Master) -> None:
        async with nodes(master) as (server, node):
            await server.advertise_action("fibonacci", Fibonacci, fibonacci)
            client = node.action_client("fibonacci", Fibonacci)

            async def one(number: int) -> int:
                goal = await client.send_goal(order(2 + number % 10))
                return len((await goal.result()).sequence)

            lengths = await asyncio.gather(*map(one, range(200)))
            assert lengths == [2 + number % 10 for number in range(200)]

    async def test_a_goal_may_be_refused_with_a_reason(self, master: Master) -> None:
        def judge(goal: FibonacciGoal) -> bool | str:
            if goal.order > 100:
                raise OverflowError("too much")
            return "odd" if goal.order % 2 else goal.order > 0

        async with nodes(master) as (server, node):
            await server.advertise_action("picky", Fibonacci, fibonacci, on_goal=judge)
            client = node.action_client("picky", Fibonacci)
            reasons = []
            for number in (3, 0, 102):
                with pytest.raises(GoalRejected) as caught:
                    await client.send_goal(order(number))
                reasons.append(caught.value.reason)
            assert reasons == [
                "rejected (odd)",
                "rejected (the server refuses it)",
                "rejected (on_goal raised OverflowError: too much)",
            ]
            assert list((await (await client.send_goal(order(2))).result()).sequence) == [0, 1]


class TestLater:
    async def test_a_goal_can_be_taken_up_again_by_its_id(self, master: Master) -> None:
        gate = asyncio.Event()

        async def waits(goal: Goal) -> FibonacciResult:
            await gate.wait()
            goal.publish_feedback(FibonacciFeedback(sequence=[9]))
            return FibonacciResult(sequence=[8])

        async with nodes(master) as (server, node):
            await server.advertise_action("later", Fibonacci, waits)
            sender = node.action_client("later", Fibonacci)
            sent = await sender.send_goal(order(1))
            assert sender.goal(sent.goal_id) is sent
            await sender.close()
            client: Client = node.action_client("later", Fibonacci)
            got: list[FibonacciFeedback] = []
            again: ClientGoal[FibonacciResult, FibonacciFeedback]
            again = client.goal(sent.goal_id.hex, feedback=got.append)
            with pytest.raises(TimeoutError, match=r"has not ended within 0\.05 s; it goes on"):
                await again.result(timeout=0.05)
            await until(lambda: again.status is GoalState.EXECUTING)
            gate.set()
            assert list((await again.result()).sequence) == [8]
            assert got == [FibonacciFeedback(sequence=[9])]
            late = node.action_client("later", Fibonacci).goal(sent.goal_id.bytes)
            assert list((await late.result()).sequence) == [8]

    async def test_results_are_forgotten_after_their_time(self, master: Master) -> None:
        async with nodes(master) as (server, node):
            gate = asyncio.Event()

            async def waits(goal: Goal) -> FibonacciResult:
                await gate.wait()
                return FibonacciResult(sequence=[0, 1])

            served = await server.advertise_action("brief", Fibonacci, waits, result_timeout_s=0.05)
            client = node.action_client("brief", Fibonacci)
            goal = await client.send_goal(order(2))
            # Who asks before the end is answered at the end, however short the result is kept.
            ending = asyncio.ensure_future(goal.result())
            await until(lambda: served._services[1].statistics.running == 1)
            gate.set()
            assert list((await ending).sequence) == [0, 1]
            await until(lambda: served._book.find(goal.goal_id.bytes) is None)
            other = node.action_client("brief", Fibonacci)
            with pytest.raises(UnknownGoal):
                await other.goal(goal.goal_id).result()
            with pytest.raises(ValueError, match="32 hexadecimal digits"):
                other.goal("abc")

    async def test_states_are_published_for_late_joiners(self, master: Master) -> None:
        async with nodes(master) as (server, node):
            await server.advertise_action("long", Fibonacci, for_ever)
            goal = await node.action_client("long", Fibonacci).send_goal(order(2))
            await until(lambda: goal.status is GoalState.EXECUTING)
            status = await node.subscribe("long/_action/status", GoalStatusArray, qos=LATCHED)
            (entry,) = (await status.receive_within(30)).status_list
            assert entry.goal_info.goal_id == goal.goal_id.bytes
            assert entry.status == GoalState.EXECUTING

    async def test_a_server_that_closes_aborts_its_goals(self, master: Master) -> None:
        async with nodes(master) as (server, node):
            served = await server.advertise_action("long", Fibonacci, for_ever, policy="queue")
            client = node.action_client("long", Fibonacci)
            goals = [await client.send_goal(order(number)) for number in range(2)]
            endings = [asyncio.ensure_future(goal.outcome()) for goal in goals]
            await asyncio.sleep(0)
            await until(lambda: served._services[1].statistics.running == 2)
            await served.close()
            for ending in endings:
                outcome = await ending
                assert outcome.state is GoalState.ABORTED
                assert outcome.error == "the action server was closed"
            with pytest.raises(ServiceUnavailable):
                await client.send_goal(order(1))
            with pytest.raises(ActionServerLost):
                await client.goal(uuid4()).result()

    async def test_a_node_that_closes_aborts_its_goals(self, master: Master) -> None:
        async with nodes(master) as (server, node):
            served = await server.advertise_action("long", Fibonacci, for_ever)
            client = node.action_client("long", Fibonacci)
            goal = await client.send_goal(order(1))
            ending = asyncio.ensure_future(goal.outcome())
            await until(lambda: served._services[1].statistics.running == 1)
            await server.close()
            assert (await ending).error == "the action server was closed"
            await node.close()
            with pytest.raises(HandleClosed):
                await client.send_goal(order(1))
            with pytest.raises(HandleClosed):
                await client.goal(goal.goal_id).cancel()

    async def test_a_connection_that_breaks_is_made_once_more(self, master: Master) -> None:
        gate = asyncio.Event()

        async def waits(goal: Goal) -> FibonacciResult:
            await gate.wait()
            return FibonacciResult(sequence=[3])

        async with nodes(master) as (server, node):
            served = await server.advertise_action("waits", Fibonacci, waits)
            goal = await node.action_client("waits", Fibonacci).send_goal(order(1))
            ending = asyncio.ensure_future(goal.result())
            results = served._services[1]
            await until(lambda: results.statistics.running == 1)
            (link,) = node.providers._links.values()
            link._transport.abort()
            await until(lambda: results.statistics.calls == 2)
            gate.set()
            assert list((await ending).sequence) == [3]


async def test_names_are_those_of_the_nodes_namespace(master: Master) -> None:
    async with (
        NodeHandle("server", master=master.address, namespace="robot1") as server,
        NodeHandle("client", master=master.address) as node,
    ):
        served = await server.advertise_action("fibonacci", Fibonacci, fibonacci)
        assert served.name == "robot1/fibonacci"
        goal = await node.action_client("robot1/fibonacci", Fibonacci).send_goal(order(3))
        assert [len(feedback.sequence) async for feedback in goal] == [3]


class TestWrongUse:
    async def test_names_types_and_settings(self, master: Master) -> None:
        other = ActionType(SensorData, Heartbeat, SensorData)
        async with nodes(master) as (server, node):
            await server.advertise_action("fibonacci", Fibonacci, fibonacci)
            with pytest.raises(RegistrationRefused, match="node 'server'"):
                await node.advertise_action("fibonacci", Fibonacci, fibonacci)
            with pytest.raises(ConfigError, match="policy"):
                await node.advertise_action("x", Fibonacci, fibonacci, policy="latest")
            client = node.action_client("fibonacci", other)
            with pytest.raises(ServiceTypeMismatch, match="Fibonacci_SendGoalRequest"):
                await client.send_goal(SensorData())
            with pytest.raises(TypeError, match=r"FibonacciGoal, not example\.SensorData"):
                await node.action_client("fibonacci", Fibonacci).send_goal(SensorData())
            with pytest.raises(ServiceUnavailable):
                await node.action_client("absent", Fibonacci).send_goal(order(1))
            with pytest.raises(TimeoutError):
                await node.action_client("absent", Fibonacci).wait_for_server(0.05)

    async def test_a_goal_whose_acceptance_is_not_heard_is_taken_back(self, master: Master) -> None:
        async def slow(goal: FibonacciGoal) -> bool:
            await asyncio.Event().wait()
            return True

        async with nodes(master) as (server, node):
            served = await server.advertise_action("slow", Fibonacci, for_ever, on_goal=slow)
            client = node.action_client("slow", Fibonacci)
            with pytest.raises(ServiceTimeout):
                await client.send_goal(order(1), timeout=0.3)
            assert served.goals == ()
            assert client._goals == {}

    async def test_a_cpp_master_knows_no_actions(self) -> None:
        async with CppMaster() as master, NodeHandle("server", master=master.address) as node:
            with pytest.raises(ForeignMaster):
                await node.advertise_action("fibonacci", Fibonacci, fibonacci)
            assert node.action_handles == set()

    async def test_it_works_on_a_fake_master(self) -> None:
        master = FakeMaster()
        async with (
            NodeHandle("server", master=master) as server,
            NodeHandle("client", master=master) as node,
        ):
            await server.advertise_action("fibonacci", Fibonacci, fibonacci)
            goal = await node.action_client("fibonacci", Fibonacci).send_goal(order(4))
            assert [len(feedback.sequence) async for feedback in goal] == [3, 4]
