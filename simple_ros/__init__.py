"""simple_ros: robot middleware in pure Python that treats the wireless link as part of the robot.

Two faces of one implementation: the blocking one is here (`SystemManager`, `NodeHandle`), the asyncio
one is `simple_ros.aio`. Messages are in `simple_ros.msg`.
"""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

from simple_ros.errors import (
    ActionError,
    ActionServerLost,
    AddressInUse,
    CancelRejected,
    ConfigError,
    FrameError,
    GoalAborted,
    GoalCanceled,
    GoalRejected,
    HandleClosed,
    InvalidGoalTransition,
    InvalidName,
    MasterUnavailable,
    MessageTooLarge,
    NodeNameTaken,
    QueueFull,
    RegistrationRefused,
    RemoteServiceError,
    ServiceCallError,
    ServiceTimeout,
    ServiceTypeMismatch,
    ServiceUnavailable,
    SimpleRosError,
    TopicTypeMismatch,
    TypeDefinitionConflict,
    UnknownGoal,
    UnknownMessageType,
)
from simple_ros.events import (
    DeadlineMissed,
    IncompatibleQos,
    LivelinessChanged,
    QosEvent,
    TypeConflict,
)
from simple_ros.graph import GraphChange, GraphSnapshot
from simple_ros.msg.registry import MsgFactory
from simple_ros.qos import (
    DEFAULT,
    LATCHED,
    SENSOR_DATA,
    Durability,
    Liveliness,
    QosProfile,
    Reliability,
)
from simple_ros.ready import ready
from simple_ros.schedule import TimerEvent

if TYPE_CHECKING:
    from simple_ros.actions.client_goal import GoalOutcome
    from simple_ros.actions.states import GoalState
    from simple_ros.arguments import Arguments, BadArgument, argv
    from simple_ros.blocking import (
        ActionClient,
        ActionServer,
        ClientGoal,
        ParameterWatch,
        Publisher,
        ServerGoal,
        ServiceClient,
        ServiceServer,
        Subscriber,
        Timer,
    )
    from simple_ros.message_queue import CallbackGroup, MessageQueue
    from simple_ros.msg.interfaces import ActionType, ServiceType
    from simple_ros.parameters.convert import ParameterInfo
    from simple_ros.parameters.errors import (
        BadParameterText,
        ParameterError,
        ParameterRefused,
        UnknownParameter,
    )
    from simple_ros.parameters.feed import ParameterChanged
    from simple_ros.rpc_client import RosRpcClient
    from simple_ros.system_manager import NodeHandle, SystemManager

# gRPC's core writes connection events to stderr; they are ours to report.
os.environ.setdefault("GRPC_VERBOSITY", "ERROR")

__all__ = [
    "DEFAULT",
    "LATCHED",
    "SENSOR_DATA",
    "ActionClient",
    "ActionError",
    "ActionServer",
    "ActionServerLost",
    "ActionType",
    "AddressInUse",
    "Arguments",
    "BadArgument",
    "BadParameterText",
    "CallbackGroup",
    "CancelRejected",
    "ClientGoal",
    "ConfigError",
    "DeadlineMissed",
    "Durability",
    "FrameError",
    "GoalAborted",
    "GoalCanceled",
    "GoalOutcome",
    "GoalRejected",
    "GoalState",
    "GraphChange",
    "GraphSnapshot",
    "HandleClosed",
    "IncompatibleQos",
    "InvalidGoalTransition",
    "InvalidName",
    "Liveliness",
    "LivelinessChanged",
    "MasterUnavailable",
    "MessageQueue",
    "MessageTooLarge",
    "MsgFactory",
    "NodeHandle",
    "NodeNameTaken",
    "ParameterChanged",
    "ParameterError",
    "ParameterInfo",
    "ParameterRefused",
    "ParameterWatch",
    "Publisher",
    "QosEvent",
    "QosProfile",
    "QueueFull",
    "RegistrationRefused",
    "Reliability",
    "RemoteServiceError",
    "RosRpcClient",
    "ServerGoal",
    "ServiceCallError",
    "ServiceClient",
    "ServiceServer",
    "ServiceTimeout",
    "ServiceType",
    "ServiceTypeMismatch",
    "ServiceUnavailable",
    "SimpleRosError",
    "Subscriber",
    "SystemManager",
    "Timer",
    "TimerEvent",
    "TopicTypeMismatch",
    "TypeConflict",
    "TypeDefinitionConflict",
    "UnknownGoal",
    "UnknownMessageType",
    "UnknownParameter",
    "argv",
    "ready",
]


_LAZY = {
    "ActionClient": "simple_ros.blocking",
    "ActionServer": "simple_ros.blocking",
    "ActionType": "simple_ros.msg.interfaces",
    "ClientGoal": "simple_ros.blocking",
    "GoalOutcome": "simple_ros.actions.client_goal",
    "GoalState": "simple_ros.actions.states",
    "ServerGoal": "simple_ros.blocking",
    "Arguments": "simple_ros.arguments",
    "BadArgument": "simple_ros.arguments",
    "argv": "simple_ros.arguments",
    "BadParameterText": "simple_ros.parameters.errors",
    "ParameterChanged": "simple_ros.parameters.feed",
    "ParameterError": "simple_ros.parameters.errors",
    "ParameterInfo": "simple_ros.parameters.convert",
    "ParameterWatch": "simple_ros.blocking",
    "ParameterRefused": "simple_ros.parameters.errors",
    "UnknownParameter": "simple_ros.parameters.errors",
    "CallbackGroup": "simple_ros.message_queue",
    "MessageQueue": "simple_ros.message_queue",
    "NodeHandle": "simple_ros.system_manager",
    "Publisher": "simple_ros.blocking",
    "RosRpcClient": "simple_ros.rpc_client",
    "ServiceClient": "simple_ros.blocking",
    "ServiceServer": "simple_ros.blocking",
    "ServiceType": "simple_ros.msg.interfaces",
    "Subscriber": "simple_ros.blocking",
    "SystemManager": "simple_ros.system_manager",
    "Timer": "simple_ros.blocking",
}


def __getattr__(name: str) -> Any:
    # What most programs do not need, and what takes long to import, is imported when it is named.
    if name in _LAZY:
        found = getattr(import_module(_LAZY[name]), name)
    elif name == "__version__":
        found = import_module("importlib.metadata").version("simple-ros")
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = found
    return found
