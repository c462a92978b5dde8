"""simple_ros: robot middleware in pure Python that treats the wireless link as part of the robot.

Two faces of one implementation: the blocking one is here (`SystemManager`, `NodeHandle`), the asyncio
one is `simple_ros.aio`. Messages are in `simple_ros.msg`.
"""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

from simple_ros.errors import (
    AddressInUse,
    ConfigError,
    FrameError,
    HandleClosed,
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
from simple_ros.schedule import TimerEvent

if TYPE_CHECKING:
    from simple_ros.blocking import Publisher, ServiceClient, ServiceServer, Subscriber, Timer
    from simple_ros.message_queue import CallbackGroup, MessageQueue
    from simple_ros.msg.interfaces import ServiceType
    from simple_ros.rpc_client import RosRpcClient
    from simple_ros.system_manager import NodeHandle, SystemManager

# gRPC's core writes connection events to stderr; they are ours to report.
os.environ.setdefault("GRPC_VERBOSITY", "ERROR")

__all__ = [
    "DEFAULT",
    "LATCHED",
    "SENSOR_DATA",
    "AddressInUse",
    "CallbackGroup",
    "ConfigError",
    "DeadlineMissed",
    "Durability",
    "FrameError",
    "GraphChange",
    "GraphSnapshot",
    "HandleClosed",
    "IncompatibleQos",
    "InvalidName",
    "Liveliness",
    "LivelinessChanged",
    "MasterUnavailable",
    "MessageQueue",
    "MessageTooLarge",
    "MsgFactory",
    "NodeHandle",
    "NodeNameTaken",
    "Publisher",
    "QosEvent",
    "QosProfile",
    "QueueFull",
    "RegistrationRefused",
    "Reliability",
    "RemoteServiceError",
    "RosRpcClient",
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
    "UnknownMessageType",
]


_LAZY = {
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
