"""The messages that wrap goals, results and feedback."""

from __future__ import annotations

from google.protobuf import descriptor_pb2

from simple_ros.actions.messages import ActionNames, messages_of
from simple_ros.msg.definitions import definition_of, message_class
from simple_ros.msg.example import Heartbeat, SensorData
from simple_ros.msg.example_interfaces import Fibonacci, FibonacciFeedback, FibonacciGoal
from simple_ros.msg.interfaces import ActionType


def test_they_are_called_as_in_ros_2() -> None:
    messages = messages_of(Fibonacci)
    assert messages.send_goal.name == "example_interfaces.Fibonacci_SendGoal"
    assert messages.get_result.name == "example_interfaces.Fibonacci_GetResult"
    assert messages.cancel_goal.name == "action_msgs.CancelGoal"
    feedback = messages.feedback.DESCRIPTOR.full_name
    assert feedback == "example_interfaces.Fibonacci_FeedbackMessage"
    assert messages_of(Fibonacci) is messages
    names = ActionNames("arm/grasp")
    assert names.send_goal == "/arm/grasp/_action/send_goal"
    assert names.feedback == "/arm/grasp/_action/feedback"


def test_they_carry_the_users_own_classes() -> None:
    messages = messages_of(Fibonacci)
    sent = messages.send_goal.request(goal_id=b"x" * 16, goal=FibonacciGoal(order=5))
    back = messages.send_goal.request.FromString(sent.SerializeToString())
    assert type(back.goal) is FibonacciGoal
    assert back.goal.order == 5
    feedback = messages.feedback(feedback=FibonacciFeedback(sequence=[1, 2]), number=7)
    assert list(feedback.feedback.sequence) == [1, 2]
    answer = messages.send_goal.response(accepted=True)
    answer.stamp.FromNanoseconds(5)
    assert answer.stamp.ToNanoseconds() == 5


def test_types_joined_by_hand_that_share_a_goal_stay_apart() -> None:
    one = messages_of(ActionType(SensorData, Heartbeat, SensorData))
    other = messages_of(ActionType(SensorData, SensorData, Heartbeat))
    names = {item.feedback.DESCRIPTOR.full_name for item in (one, other)}
    assert len(names) == 2
    assert all(name.startswith("example.SensorData_example_") for name in names)
    assert one.get_result.response(result=Heartbeat(timestamp=3)).result.timestamp == 3


def test_classes_that_a_tool_was_given_work_as_well() -> None:
    """Each is alone in a pool that knows nothing of ours."""
    classes = [
        message_class(definition_of(part), str(part.DESCRIPTOR.full_name))
        for part in Fibonacci.classes
    ]
    theirs = messages_of(ActionType(*classes))
    ours = messages_of(Fibonacci)
    request = theirs.send_goal.request(goal=classes[0](order=3))
    assert ours.send_goal.request.FromString(request.SerializeToString()).goal.order == 3
    assert definition_names(theirs.feedback) == definition_names(ours.feedback)


def definition_names(message: type) -> list[str]:
    files: descriptor_pb2.FileDescriptorSet = definition_of(message)
    return sorted(item.name for file in files.file for item in file.message_type)
