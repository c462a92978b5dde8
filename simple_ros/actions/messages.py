"""The messages that wrap a goal, a result and feedback on their way, made for each type of action.

They are called as in ROS 2: for ``example_interfaces.Fibonacci`` there are
``example_interfaces.Fibonacci_SendGoalRequest``, ``..._SendGoalResponse``, ``..._GetResultRequest``,
``..._GetResultResponse`` and ``..._FeedbackMessage``. So two types of action never meet by mistake, and
tools show what is inside. Each is made in the descriptor pool of the message it wraps, which need not be
the process's own: a tool has classes it was given by the Master.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from google.protobuf import message_factory
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto
from google.protobuf.message import Message
from google.protobuf.timestamp_pb2 import Timestamp

from simple_ros.msg.action_msgs import CancelGoal, GoalStatus, GoalStatusArray
from simple_ros.msg.interfaces import ActionType, ServiceType

__all__ = ["ActionMessages", "ActionNames", "messages_of"]


@dataclass(frozen=True, slots=True)
class ActionNames:
    """The names of the parts of an action; absolute, as no namespace comes before them again.

    Args:
        action: Canonical name of the action.
    """

    action: str

    @property
    def send_goal(self) -> str:
        """A service."""
        return f"/{self.action}/_action/send_goal"

    @property
    def cancel_goal(self) -> str:
        """A service."""
        return f"/{self.action}/_action/cancel_goal"

    @property
    def get_result(self) -> str:
        """A service, which answers when the goal has ended."""
        return f"/{self.action}/_action/get_result"

    @property
    def feedback(self) -> str:
        """A topic."""
        return f"/{self.action}/_action/feedback"

    @property
    def status(self) -> str:
        """A topic."""
        return f"/{self.action}/_action/status"


@dataclass(frozen=True, slots=True)
class ActionMessages:
    """What travels for one type of action.

    Attributes:
        send_goal: ``goal_id, goal`` -> ``accepted, stamp, reason``.
        get_result: ``goal_id`` -> ``status, result, error_type, error, feedback_count``.
        cancel_goal: As in ROS 2, the same for all.
        feedback: ``goal_id, feedback, number``; numbers of a goal begin at 1.
        status: The same for all.
    """

    send_goal: ServiceType[Any, Any]
    get_result: ServiceType[Any, Any]
    cancel_goal: ServiceType[Any, Any]
    feedback: type[Any]
    status: type[GoalStatusArray]


@lru_cache(maxsize=256)
def messages_of(kind: ActionType[Any, Any, Any]) -> ActionMessages:
    """The messages for a type of action."""
    package, stem = _stem(kind)

    def made(inner: type[Message], suffix: str, *fields: FieldDescriptorProto) -> type[Any]:
        return _made(inner, package, f"{stem}_{suffix}", fields)

    return ActionMessages(
        send_goal=ServiceType(
            made(kind.goal, "SendGoalRequest", _bytes("goal_id", 1), _of("goal", 2, kind.goal)),
            made(
                kind.goal,
                "SendGoalResponse",
                _scalar("accepted", 1, FieldDescriptorProto.TYPE_BOOL),
                _of("stamp", 2, Timestamp),
                _string("reason", 3),
            ),
        ),
        get_result=ServiceType(
            made(kind.result, "GetResultRequest", _bytes("goal_id", 1)),
            made(
                kind.result,
                "GetResultResponse",
                _status("status", 1),
                _of("result", 2, kind.result),
                _string("error_type", 3),
                _string("error", 4),
                _scalar("feedback_count", 5, FieldDescriptorProto.TYPE_UINT32),
            ),
        ),
        cancel_goal=CancelGoal,
        feedback=made(
            kind.feedback,
            "FeedbackMessage",
            _bytes("goal_id", 1),
            _of("feedback", 2, kind.feedback),
            _scalar("number", 3, FieldDescriptorProto.TYPE_UINT32),
        ),
        status=GoalStatusArray,
    )


def _stem(kind: ActionType[Any, Any, Any]) -> tuple[str, str]:
    """A package, and how the names in it begin: no two types of action share them."""
    descriptor = kind.goal.DESCRIPTOR
    package: str = descriptor.file.package
    if " -> " in kind.name:
        name = "_".join(str(part.DESCRIPTOR.full_name) for part in kind.classes)
    else:
        name = kind.name
    return package, name.removeprefix(f"{package}.").replace(".", "_")


def _scalar(name: str, number: int, kind: FieldDescriptorProto.Type.ValueType) -> Any:
    label = FieldDescriptorProto.LABEL_OPTIONAL
    return FieldDescriptorProto(name=name, number=number, type=kind, label=label)


def _bytes(name: str, number: int) -> Any:
    return _scalar(name, number, FieldDescriptorProto.TYPE_BYTES)


def _string(name: str, number: int) -> Any:
    return _scalar(name, number, FieldDescriptorProto.TYPE_STRING)


def _of(name: str, number: int, inner: type[Message]) -> Any:
    field = _scalar(name, number, FieldDescriptorProto.TYPE_MESSAGE)
    field.type_name = f".{inner.DESCRIPTOR.full_name}"
    return field


def _status(name: str, number: int) -> Any:
    field = _scalar(name, number, FieldDescriptorProto.TYPE_ENUM)
    field.type_name = f".{GoalStatus.DESCRIPTOR.full_name}.Status"
    return field


_MAY_NEED = (GoalStatus.DESCRIPTOR.file, Timestamp.DESCRIPTOR.file)


def _made(
    inner: type[Message], package: str, name: str, fields: tuple[FieldDescriptorProto, ...]
) -> type[Any]:
    pool = inner.DESCRIPTOR.file.pool
    full_name = f"{package}.{name}" if package else name
    file = FileDescriptorProto(
        name=f"simple_ros/actions/{full_name}.proto", package=package, syntax="proto3"
    )
    needed = [inner.DESCRIPTOR.file, *_MAY_NEED]
    for other in needed:
        _ensure(pool, other)
        if other.name not in file.dependency:
            file.dependency.append(other.name)
    file.message_type.add(name=name).field.extend(fields)
    pool.Add(file)
    descriptor: Any = pool.FindMessageTypeByName(full_name)
    return message_factory.GetMessageClass(descriptor)


def _ensure(pool: Any, file: Any) -> None:
    """Let a pool know a file and what it depends on."""
    try:
        pool.FindFileByName(file.name)
    except KeyError:
        for other in file.dependencies:
            _ensure(pool, other)
        copied = FileDescriptorProto()
        file.CopyToProto(copied)
        pool.Add(copied)
