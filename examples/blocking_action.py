"""The blocking face: an action server and its client, with no event loop in sight.

The goal is executed in one thread that spins, so the client here waits in another one.
"""

import threading

from simple_ros import NodeHandle, ServerGoal, SystemManager
from simple_ros.msg.example_interfaces import (
    Fibonacci,
    FibonacciFeedback,
    FibonacciGoal,
    FibonacciResult,
)

system = SystemManager.instance()
system.init("blocking_action")
node = NodeHandle()


def execute(
    goal: ServerGoal[FibonacciGoal, FibonacciResult, FibonacciFeedback],
) -> FibonacciResult | None:
    """Runs in the thread that spins, and looks itself whether it is to end."""
    sequence = [0, 1]
    while len(sequence) < goal.goal.order:
        if goal.wait_cancel_requested(0.05):
            goal.canceled(FibonacciResult(sequence=sequence))
            return None
        sequence.append(sequence[-1] + sequence[-2])
        goal.publish_feedback(FibonacciFeedback(sequence=sequence))
    return FibonacciResult(sequence=sequence)


server = node.advertise_action("fibonacci", Fibonacci, execute)
threading.Thread(target=system.spin, daemon=True).start()

client = node.action_client("fibonacci", Fibonacci)
goal = client.send_goal(FibonacciGoal(order=5))
for feedback in goal:
    print("so far:", list(feedback.sequence))
print("result:", list(goal.result().sequence))
system.shutdown()
