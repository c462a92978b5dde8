"""Actions of the blocking face."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest
from support.waiting import LIMIT_S

from simple_ros import (
    ActionClient,
    CallbackGroup,
    GoalAborted,
    GoalCanceled,
    GoalRejected,
    GoalState,
    NodeHandle,
    RegistrationRefused,
    ServerGoal,
    SystemManager,
)
from simple_ros.msg.example_interfaces import (
    Fibonacci,
    FibonacciFeedback,
    FibonacciGoal,
    FibonacciResult,
)
from simple_ros.net.loop import BackgroundLoop
from simple_ros_master import Master

Goal = ServerGoal[FibonacciGoal, FibonacciResult, FibonacciFeedback]
Client = ActionClient[FibonacciGoal, FibonacciResult, FibonacciFeedback]


@pytest.fixture
def system() -> Iterator[SystemManager]:
    loop = BackgroundLoop()
    master = Master(host="127.0.0.1", port=0)
    loop.run(master.start())
    manager = SystemManager.instance()
    manager.init("blocking", master=master.address)
    yield manager
    manager.shutdown()
    loop.run(master.stop())
    loop.stop()


def spinning(system: SystemManager, threads: int = 1) -> threading.Thread:
    thread = threading.Thread(target=system.spin, args=(threads,), daemon=True)
    thread.start()
    return thread


def execute(goal: Goal) -> FibonacciResult | None:
    if goal.goal.order < 0:
        raise ValueError("negative")
    sequence = [0, 1]
    while len(sequence) < goal.goal.order:
        sequence.append((sequence[-1] + sequence[-2]) % 1000)
        goal.publish_feedback(FibonacciFeedback(sequence=sequence[:5]))
        if len(sequence) > 5 and goal.wait_cancel_requested(5.0):
            assert goal.is_cancel_requested
            goal.canceled(FibonacciResult(sequence=sequence[:5]), "stopped")
            return None
    return FibonacciResult(sequence=sequence)


def test_goal_feedback_result_and_cancel(system: SystemManager) -> None:
    node = NodeHandle()
    served = node.advertise_action("/fibonacci", Fibonacci, execute)
    thread = spinning(system)
    client: Client = node.action_client("fibonacci", Fibonacci)
    client.wait_for_server(30)
    goal = client.send_goal(FibonacciGoal(order=4))
    assert [len(feedback.sequence) for feedback in goal] == [3, 4]
    assert list(goal.result(30.0).sequence) == [0, 1, 1, 2]
    assert goal.status is GoalState.SUCCEEDED
    assert list(client.goal(goal.goal_id).result(30.0).sequence) == [0, 1, 1, 2]

    with pytest.raises(GoalAborted, match="ValueError: negative"):
        client.send_goal(FibonacciGoal(order=-1)).result(30.0)

    long = client.send_goal(FibonacciGoal(order=100))
    assert [running.goal_id for running in served.goals] == [long.goal_id]
    assert long.cancel()
    with pytest.raises(GoalCanceled, match="stopped") as caught:
        long.result(30.0)
    assert isinstance(caught.value.result, FibonacciResult)
    assert long.outcome().state is GoalState.CANCELED
    with pytest.raises(RegistrationRefused):
        node.advertise_action("fibonacci", Fibonacci, execute)
    served.close()
    system.shutdown()
    thread.join(30)
    assert not thread.is_alive()


def test_callbacks_run_in_threads_that_spin(system: SystemManager) -> None:
    node = NodeHandle()
    here: set[str] = set()

    def noted(value: object) -> bool:
        here.add(threading.current_thread().name)
        return not isinstance(value, FibonacciGoal) or value.order < 1000

    group = CallbackGroup(reentrant=True)
    node.advertise_action(
        "fibonacci", Fibonacci, execute, on_goal=noted, on_cancel=noted, group=group
    )
    spinning(system, threads=3)
    client: Client = node.action_client("fibonacci", Fibonacci)
    got: list[int] = []
    quick = client.send_goal(FibonacciGoal(order=4), feedback=lambda m: got.append(len(m.sequence)))
    quick.result(30.0)
    goals = [client.send_goal(FibonacciGoal(order=99)) for _ in range(2)]
    assert len(client.cancel_all()) == 2
    assert [goal.outcome(30.0).state for goal in goals] == [GoalState.CANCELED] * 2
    with pytest.raises(GoalRejected):
        client.send_goal(FibonacciGoal(order=1000))
    end = time.monotonic() + LIMIT_S
    while len(got) < 2 and time.monotonic() < end:
        time.sleep(0.002)
    assert got == [3, 4]
    assert "simple_ros loop" not in here


def test_the_only_thread_that_spins_does_not_wait_for_itself(system: SystemManager) -> None:
    node = NodeHandle()
    node.advertise_action("fibonacci", Fibonacci, execute)
    client: Client = node.action_client("fibonacci", Fibonacci)
    caught: list[BaseException] = []

    def tick(event: object) -> None:
        try:
            client.send_goal(FibonacciGoal(order=3))
        except RuntimeError as error:
            caught.append(error)

    node.create_timer(0.001, tick, oneshot=True)
    end = time.monotonic() + LIMIT_S
    while not caught and time.monotonic() < end:
        system.spin_once(0.05)
    assert "the one that waits" in str(caught[0])
