"""An action server: computes Fibonacci numbers, tells how far it is, and can be cancelled."""

import asyncio

from simple_ros import aio
from simple_ros.msg.example_interfaces import (
    Fibonacci,
    FibonacciFeedback,
    FibonacciGoal,
    FibonacciResult,
)


async def execute(
    goal: aio.ServerGoal[FibonacciGoal, FibonacciResult, FibonacciFeedback],
) -> FibonacciResult:
    sequence = [0, 1]
    while len(sequence) < goal.goal.order:
        # A cancel comes out of this sleep as CancelledError.
        await asyncio.sleep(0.1)
        sequence.append(sequence[-1] + sequence[-2])
        goal.publish_feedback(FibonacciFeedback(sequence=sequence))
    return FibonacciResult(sequence=sequence)


def judge(goal: FibonacciGoal) -> bool | str:
    return True if 2 <= goal.order <= 46 else "the order must be 2 to 46"


async def main() -> None:
    async with aio.NodeHandle("action_server") as node:
        await node.advertise_action("fibonacci", Fibonacci, execute, on_goal=judge)
        await node.spin()


aio.run(main())
