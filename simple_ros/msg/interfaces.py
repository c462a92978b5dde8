"""Service and action types: which messages belong together.

The type ``std_srvs.SetBool`` of a service is the pair of messages ``std_srvs.SetBoolRequest`` and
``std_srvs.SetBoolResponse``; the type ``example_interfaces.Fibonacci`` of an action the messages
``FibonacciGoal``, ``FibonacciResult`` and ``FibonacciFeedback`` of that package. Other messages can be
joined by hand.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from google.protobuf.message import Message

from simple_ros.errors import UnknownMessageType
from simple_ros.msg.registry import MsgFactory

__all__ = ["ActionType", "ServiceType", "action_type", "service_type"]

RequestT = TypeVar("RequestT", bound=Message)
ResponseT = TypeVar("ResponseT", bound=Message)
GoalT = TypeVar("GoalT", bound=Message)
ResultT = TypeVar("ResultT", bound=Message)
FeedbackT = TypeVar("FeedbackT", bound=Message)


@dataclass(frozen=True, slots=True)
class ServiceType(Generic[RequestT, ResponseT]):
    """A pair of message classes."""

    request: type[RequestT]
    response: type[ResponseT]

    @property
    def name(self) -> str:
        """``package.Name`` if both are called alike, else ``package.Request -> package.Response``."""
        request, response = _name(self.request), _name(self.response)
        stem = request.removesuffix("Request")
        if request != stem and response == f"{stem}Response":
            return stem
        return f"{request} -> {response}"

    @property
    def classes(self) -> tuple[type[Message], ...]:
        """All of them."""
        return self.request, self.response


@dataclass(frozen=True, slots=True)
class ActionType(Generic[GoalT, ResultT, FeedbackT]):
    """Three message classes."""

    goal: type[GoalT]
    result: type[ResultT]
    feedback: type[FeedbackT]

    @property
    def name(self) -> str:
        """``package.Name`` if all are called alike, else the three names."""
        goal, result, feedback = map(_name, self.classes)
        stem = goal.removesuffix("Goal")
        if goal != stem and (result, feedback) == (f"{stem}Result", f"{stem}Feedback"):
            return stem
        return f"{goal} -> {result}, {feedback}"

    @property
    def classes(self) -> tuple[type[Message], ...]:
        """All of them."""
        return self.goal, self.result, self.feedback


def service_type(given: Any) -> ServiceType[Any, Any]:
    """A service type from what users write.

    Args:
        given: A `ServiceType`, a pair of message classes or of their names, or the type's own name
            (``std_srvs.SetBool``, ``std_srvs/SetBool``, ``std_srvs/srv/SetBool``).

    Raises:
        UnknownMessageType: A name is not known here.
        TypeError: It is none of these.
    """
    if isinstance(given, ServiceType):
        return given
    if isinstance(given, str):
        stem = _dotted(given)
        return ServiceType(_class(f"{stem}Request"), _class(f"{stem}Response"))
    if isinstance(given, tuple) and len(given) == 2:
        return ServiceType(_class(given[0]), _class(given[1]))
    raise TypeError(
        f"{given!r} is no service type: give a ServiceType, two message classes or a name"
    )


def action_type(given: Any) -> ActionType[Any, Any, Any]:
    """An action type from what users write, as `service_type`.

    Raises:
        UnknownMessageType: A name is not known here.
        TypeError: It is none of these.
    """
    if isinstance(given, ActionType):
        return given
    if isinstance(given, str):
        stem = _dotted(given)
        return ActionType(*(_class(stem + part) for part in ("Goal", "Result", "Feedback")))
    if isinstance(given, tuple) and len(given) == 3:
        return ActionType(_class(given[0]), _class(given[1]), _class(given[2]))
    raise TypeError(
        f"{given!r} is no action type: give an ActionType, three message classes or a name"
    )


def _class(given: Any) -> type[Message]:
    if isinstance(given, str):
        return MsgFactory.instance().get_class(_dotted(given))
    if isinstance(given, type) and issubclass(given, Message):
        return given
    raise TypeError(f"{given!r} is not a protobuf message class")


def _dotted(name: str) -> str:
    parts = [part for part in name.replace("::", "/").replace(".", "/").split("/") if part]
    kept = [part for part in parts if part not in ("srv", "action", "msg")]
    if not kept:
        raise UnknownMessageType(name)
    return ".".join(kept)


def _name(message_class: type[Message]) -> str:
    return str(message_class.DESCRIPTOR.full_name)
