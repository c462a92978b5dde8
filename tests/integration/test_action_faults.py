"""Actions between processes that die: server, client and Master."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest
from support.processes import Process, master_process, program
from support.waiting import Stopwatch, until

from simple_ros import ActionServerLost, GoalState, ServiceUnavailable, UnknownGoal
from simple_ros.aio import NodeHandle
from simple_ros.msg.example_interfaces import Fibonacci, FibonacciGoal
from simple_ros_master import Master

SERVER = """
    import asyncio, sys
    from simple_ros import aio
    from simple_ros.msg.example_interfaces import Fibonacci, FibonacciFeedback, FibonacciResult

    async def execute(goal):
        for number in range(goal.goal.order):
            goal.publish_feedback(FibonacciFeedback(sequence=[number]))
            await asyncio.sleep(0.02)
        return FibonacciResult(sequence=[goal.goal.order])

    async def main():
        async with aio.NodeHandle("server") as node:
            await node.advertise_action("count", Fibonacci, execute)
            print("ready", flush=True)
            await node.spin()
    aio.run(main())
"""
CLIENT = """
    import asyncio, sys
    from simple_ros import aio
    from simple_ros.msg.example_interfaces import Fibonacci, FibonacciGoal

    async def main():
        async with aio.NodeHandle("client") as node:
            client = node.action_client("count", Fibonacci)
            if len(sys.argv) == 1:
                goal = await client.send_goal(FibonacciGoal(order=20))
                print(goal.goal_id.hex, flush=True)
                await asyncio.Event().wait()
            goal = client.goal(sys.argv[1])
            count = 0
            async for feedback in goal:
                count += 1
            print(list((await goal.result()).sequence), count > 0, flush=True)
    aio.run(main())
"""


@asynccontextmanager
async def server(address: str) -> AsyncIterator[Process]:
    async with program(SERVER, master=address) as process:
        assert await process.line() == "ready"
        yield process


async def test_a_killed_server_is_told_at_once_and_a_new_one_knows_nothing(master: Master) -> None:
    async with NodeHandle("client", master=master.address) as node:
        client = node.action_client("count", Fibonacci)
        async with server(master.address) as process:
            goal = await client.send_goal(FibonacciGoal(order=10_000))
            ending = asyncio.ensure_future(goal.result())
            iterator = aiter(goal)
            await anext(iterator)
            (link,) = node.providers._links.values()
            await until(lambda: len(link._pending) == 2, "both wait for the result")
            watch = Stopwatch()
            process.signal(signal.SIGKILL)
            with pytest.raises(ActionServerLost, match="node 'server' is gone"):
                await ending
            with pytest.raises(ActionServerLost):
                async for _ in iterator:
                    pass
            assert watch.seconds < 2.0
            with pytest.raises((ServiceUnavailable, UnknownGoal)):
                await goal.cancel()
        async with server(master.address):
            await client.wait_for_server(30)
            with pytest.raises(UnknownGoal):
                await goal.result()
            again = await client.send_goal(FibonacciGoal(order=3))
            assert [list(feedback.sequence) async for feedback in again] == [[0], [1], [2]]


async def test_a_killed_client_fetches_the_result_when_it_is_back(master: Master) -> None:
    async with server(master.address):
        async with program(CLIENT, master=master.address) as process:
            goal_id = await process.line()
            process.signal(signal.SIGKILL)
        async with program(CLIENT, goal_id, master=master.address) as process:
            assert (await process.line()).startswith("[20] ")
            assert await process.wait() == 0
        async with program(CLIENT, goal_id, master=master.address) as process:
            assert (await process.line()).startswith("[20] ")


async def test_a_goal_does_not_mind_that_the_master_is_killed() -> None:
    async with master_process() as (first, address), server(address):
        async with NodeHandle("client", master=address) as node:
            client = node.action_client("count", Fibonacci)
            goal = await client.send_goal(FibonacciGoal(order=60))
            numbers = []
            async for feedback in goal:
                numbers.append(feedback.sequence[0])
                if len(numbers) == 5:
                    first.signal(signal.SIGKILL)
                    await first.wait()
                if len(numbers) == 10:
                    # The server takes goals all the while, too.
                    short = await client.send_goal(FibonacciGoal(order=2))
                    assert list((await short.result()).sequence) == [2]
            assert numbers == list(range(60))
            assert list((await goal.result()).sequence) == [60]
            async with master_process(int(address.rpartition(":")[2])):
                await node.wait_for_master(30)
                newcomer = NodeHandle("newcomer", master=address)
                async with newcomer:
                    other = newcomer.action_client("count", Fibonacci)
                    await other.wait_for_server(30)
                    sent = await other.send_goal(FibonacciGoal(order=2))
                    assert list((await sent.result()).sequence) == [2]
                    await until(lambda: sent.status is GoalState.SUCCEEDED)
