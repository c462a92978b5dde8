"""An action client: sends a goal, watches it, fetches the result; then sends one and cancels it."""

from simple_ros import GoalCanceled, aio
from simple_ros.msg.example_interfaces import Fibonacci, FibonacciGoal


async def main() -> None:
    async with aio.NodeHandle("action_client") as node:
        client = node.action_client("fibonacci", Fibonacci)
        await client.wait_for_server()

        goal = await client.send_goal(FibonacciGoal(order=5))
        async for feedback in goal:
            print("so far:", list(feedback.sequence))
        print("result:", list((await goal.result()).sequence))

        goal = await client.send_goal(FibonacciGoal(order=40))
        await goal.cancel()
        try:
            await goal.result()
        except GoalCanceled:
            print("the second goal was canceled")


aio.run(main())
