"""Every error this project raises on purpose.

Each error also inherits the builtin a caller would expect and carries its facts as attributes::

    SimpleRosError
    ├── InvalidName            ValueError       a topic, node or frame name breaks the rules
    ├── UnknownMessageType     LookupError      no message class of that full name
    ├── ConfigError            ValueError       a setting has no meaning
    ├── HandleClosed           RuntimeError     a node, publisher or subscription is used after close()
    ├── AddressInUse           OSError          somebody else listens on the port
    ├── FrameError             ValueError       a byte stream is not simple_ros framing
    ├── MessageTooLarge        ValueError       a message does not fit the frame or the limit
    ├── QueueFull              BlockingIOError  an ``overflow="block"`` publisher has no room now
    ├── MasterUnavailable      ConnectionError  nobody answers at the Master's address
    ├── RegistrationRefused    RuntimeError     the Master said no
    ├── NodeNameTaken          RuntimeError     a newer node runs under this node's name
    ├── TopicTypeMismatch      TypeError        the topic carries another message type
    ├── ServiceTypeMismatch    TypeError        the service has another type
    ├── ServiceCallError       Exception        a call of a service did not succeed
    │   ├── ServiceUnavailable ConnectionError  nobody provides it, or its provider is gone
    │   ├── ServiceTimeout     TimeoutError     no answer in time
    │   └── RemoteServiceError RuntimeError     its handler raised an exception
    ├── ActionError            Exception        a goal of an action did not go as wanted
    │   ├── GoalRejected       RuntimeError     the server did not accept it
    │   ├── GoalAborted        RuntimeError     the server gave it up
    │   ├── GoalCanceled       RuntimeError     it was canceled, or a newer one took its place
    │   ├── CancelRejected     RuntimeError     the server does not let it be canceled
    │   ├── UnknownGoal        LookupError      the server knows no such goal (any more)
    │   └── ActionServerLost   ConnectionError  the server ended before the goal did
    ├── InvalidGoalTransition  RuntimeError     that cannot happen to a goal in this state
    └── TypeDefinitionConflict TypeError        a message type is known with another definition
"""

from __future__ import annotations

from collections.abc import Sequence

__all__ = [
    "ActionError",
    "ActionServerLost",
    "AddressInUse",
    "CancelRejected",
    "ConfigError",
    "FrameError",
    "GoalAborted",
    "GoalCanceled",
    "GoalRejected",
    "HandleClosed",
    "InvalidGoalTransition",
    "InvalidName",
    "MasterUnavailable",
    "MessageTooLarge",
    "NodeNameTaken",
    "QueueFull",
    "RegistrationRefused",
    "RemoteServiceError",
    "ServiceCallError",
    "ServiceTimeout",
    "ServiceTypeMismatch",
    "ServiceUnavailable",
    "SimpleRosError",
    "TopicTypeMismatch",
    "TypeDefinitionConflict",
    "UnknownGoal",
    "UnknownMessageType",
]


_EXCERPT = 60
"""So many characters of a bad name are printed on each side of the mistake."""


class SimpleRosError(Exception):
    """Root of the project's errors."""


class InvalidName(SimpleRosError, ValueError):
    """A name breaks the naming rules; the message points at the character.

    Attributes:
        name: The name as given.
        position: Index of the offending character, 0 for an empty name.
        reason: What is wrong with it.
    """

    def __init__(self, kind: str, name: str, position: int, reason: str) -> None:
        self.kind = kind
        self.name = name
        self.position = position
        self.reason = reason
        shown, column = _excerpt(name, position)
        super().__init__(f"{kind} name {reason}:\n  {shown}\n  {' ' * column}^")


def _excerpt(name: str, position: int) -> tuple[str, int]:
    """A name as it is printed, of a long one the part about a position, and that position in it."""
    start = max(0, position - _EXCERPT)
    part = name[start : position + _EXCERPT]
    before, after = "..." * (start > 0), "..." * (position + _EXCERPT < len(name))
    return f"{before}{part!r}{after}", len(before) + 1 + position - start


class UnknownMessageType(SimpleRosError, LookupError):
    """No message class of that full name can be found.

    Attributes:
        type_name: The name asked for.
        suggestions: Known names that look like it.
    """

    def __init__(self, type_name: str, suggestions: Sequence[str] = ()) -> None:
        self.type_name = type_name
        self.suggestions = tuple(suggestions)
        hint = f"; did you mean {' or '.join(self.suggestions)}?" if suggestions else ""
        super().__init__(f"unknown message type {type_name!r}{hint}")


class ConfigError(SimpleRosError, ValueError):
    """A setting has no meaning; the message names it and what would be right."""


class HandleClosed(SimpleRosError, RuntimeError):
    """A node, publisher, subscription or timer is used after it was closed."""

    def __init__(self, what: str) -> None:
        self.what = what
        super().__init__(f"{what} is closed")


class AddressInUse(SimpleRosError, OSError):
    """Somebody else listens on the address.

    Attributes:
        address: ``host:port``.
    """

    def __init__(self, address: str, hint: str = "") -> None:
        self.address = address
        super().__init__(f"{address} is in use by another program{hint}")


class FrameError(SimpleRosError, ValueError):
    """A byte stream is not simple_ros framing; the link it came on must close.

    Attributes:
        reason: What was found.
    """

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(reason)


class MessageTooLarge(SimpleRosError, ValueError):
    """A message does not fit.

    Attributes:
        size: Its size in bytes.
        limit: The limit in bytes.
    """

    def __init__(self, topic: str, size: int, limit: int) -> None:
        self.topic = topic
        self.size = size
        self.limit = limit
        super().__init__(f"message of {size} bytes on {topic!r} is over the limit of {limit} bytes")


class QueueFull(SimpleRosError, BlockingIOError):
    """A publisher with ``overflow="block"`` has no room now; nothing was sent or queued."""

    def __init__(self, topic: str) -> None:
        self.topic = topic
        super().__init__(
            f"a subscriber of {topic!r} cannot keep up; use 'await publisher.publish_async(msg)' "
            "to wait for room"
        )


class MasterUnavailable(SimpleRosError, ConnectionError):
    """Nobody answers at the Master's address.

    Attributes:
        address: ``host:port`` that was tried.
    """

    def __init__(self, address: str, reason: str = "") -> None:
        self.address = address
        detail = f" ({reason})" if reason else ""
        super().__init__(
            f"no Master answers at {address}{detail}; start one with 'simple-ros-master' or point "
            "SIMPLE_ROS_MASTER at it"
        )


class RegistrationRefused(SimpleRosError, RuntimeError):
    """The Master refused a registration; the message carries its reason."""


class NodeNameTaken(SimpleRosError, RuntimeError):
    """A newer node registered under this node's name; this one has stopped registering.

    Attributes:
        node_name: The name both want.
        taken_by: Address ``ip:port`` of the newer node, empty if unknown.
    """

    def __init__(self, node_name: str, taken_by: str = "") -> None:
        self.node_name = node_name
        self.taken_by = taken_by
        where = f" at {taken_by}" if taken_by else ""
        super().__init__(f"node name {node_name!r} was taken over by a newer node{where}")


class TopicTypeMismatch(SimpleRosError, TypeError):
    """A topic carries another message type.

    Attributes:
        topic: Canonical topic name.
        node_name: The node that came with ``msg_type``.
        msg_type: The type it came with.
        existing_type: The type the topic has.
        existing_nodes: Names of the nodes that use ``existing_type``.
    """

    def __init__(
        self,
        topic: str,
        node_name: str,
        msg_type: str,
        existing_type: str,
        existing_nodes: Sequence[str] = (),
    ) -> None:
        self.topic = topic
        self.node_name = node_name
        self.msg_type = msg_type
        self.existing_type = existing_type
        self.existing_nodes = tuple(existing_nodes)
        others = ", ".join(repr(name) for name in existing_nodes) or "another node"
        super().__init__(
            f"topic {topic!r}: node {node_name!r} uses {msg_type}, "
            f"but {others} uses {existing_type}"
        )


class TypeDefinitionConflict(SimpleRosError, TypeError):
    """A message type is known with another definition.

    Attributes:
        type_name: Full name of the message or enum that differs.
        difference: The fields that differ, one a line: ``-`` as known, ``+`` as given.
    """

    def __init__(self, type_name: str, difference: str) -> None:
        self.type_name = type_name
        self.difference = difference
        super().__init__(
            f"{type_name} is already known with another definition "
            f"(- as known, + as given):\n{difference}"
        )


class ServiceTypeMismatch(SimpleRosError, TypeError):
    """A service has another type than its client.

    Attributes:
        service: Its name.
        wanted: The client's type.
        found: The provider's type.
        node: Who provides it.
    """

    def __init__(self, service: str, wanted: str, found: str, node: str) -> None:
        self.service = service
        self.wanted = wanted
        self.found = found
        self.node = node
        super().__init__(f"service {service!r} of node {node!r} has type {found}, not {wanted}")


class ServiceCallError(SimpleRosError):
    """A call of a service did not succeed.

    Attributes:
        service: Its name.
        reason: Why.
    """

    def __init__(self, service: str, reason: str) -> None:
        self.service = service
        self.reason = reason
        super().__init__(f"service {service!r}: {reason}")


class ServiceUnavailable(ServiceCallError, ConnectionError):
    """Nobody provides the service, or its provider is gone. Whether the call was begun is not known."""


class ServiceTimeout(ServiceCallError, TimeoutError):
    """No answer in time; the provider was told to stop."""


class RemoteServiceError(ServiceCallError, RuntimeError):
    """The handler of a service raised an exception.

    Attributes:
        node: Who provides it.
        type: Name of the exception's class.
        message: Its text.
    """

    def __init__(self, service: str, node: str, type: str, message: str) -> None:  # noqa: A002
        self.node = node
        self.type = type
        self.message = message
        super().__init__(service, f"node {node!r} raised {type}: {message}")


class ActionError(SimpleRosError):
    """A goal of an action did not go as wanted.

    Attributes:
        action: Name of the action.
        goal_id: Of the goal, 32 hexadecimal digits; empty if it never had one.
        reason: Why.
    """

    def __init__(self, action: str, goal_id: str, reason: str) -> None:
        self.action = action
        self.goal_id = goal_id
        self.reason = reason
        goal = f", goal {goal_id}" if goal_id else ""
        super().__init__(f"action {action!r}{goal}: {reason}")


class GoalRejected(ActionError, RuntimeError):
    """The server did not accept the goal."""


class GoalAborted(ActionError, RuntimeError):
    """The server gave the goal up.

    Attributes:
        result: The result it gave nevertheless, else an empty one.
        type: Class of the exception that ended the goal; empty if none did.
        message: Its text, or what the server said.
    """

    def __init__(self, action: str, goal_id: str, result: object, type: str, message: str) -> None:  # noqa: A002
        self.result = result
        self.type = type
        self.message = message
        said = ": ".join(part for part in (type, message) if part)
        super().__init__(action, goal_id, f"aborted ({said})" if said else "aborted")


class GoalCanceled(ActionError, RuntimeError):
    """The goal was canceled, or a newer one took its place.

    Attributes:
        result: The result so far, if the server gave one, else an empty one.
        message: What the server said.
    """

    def __init__(self, action: str, goal_id: str, result: object, message: str) -> None:
        self.result = result
        self.message = message
        super().__init__(action, goal_id, f"canceled ({message})" if message else "canceled")


class CancelRejected(ActionError, RuntimeError):
    """The server does not let the goal be canceled; it goes on."""


class UnknownGoal(ActionError, LookupError):
    """The server knows no such goal: it never did, it was restarted, or the result's time is over."""


class ActionServerLost(ActionError, ConnectionError):
    """The server ended before the goal did; what became of the goal is not known."""


class InvalidGoalTransition(SimpleRosError, RuntimeError):
    """That cannot happen to a goal in the state it is in.

    Attributes:
        goal_id: Of the goal.
        state: Name of the state.
        event: What was to happen.
    """

    def __init__(self, goal_id: str, state: str, event: str) -> None:
        self.goal_id = goal_id
        self.state = state
        self.event = event
        goal = f"goal {goal_id}" if goal_id else "a goal"
        super().__init__(f"{goal} is {state}: {event!r} cannot happen to it")
