"""simple_ros: robot middleware in pure Python that treats the wireless link as part of the robot.

The asyncio face (nodes, publishers, subscribers, timers) is `simple_ros.aio`; messages are in
`simple_ros.msg`. Here are the values and errors that both share.
"""

import os

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

# gRPC's core writes connection events to stderr; they are ours to report.
os.environ.setdefault("GRPC_VERBOSITY", "ERROR")

__all__ = [
    "DEFAULT",
    "LATCHED",
    "SENSOR_DATA",
    "AddressInUse",
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
    "MessageTooLarge",
    "MsgFactory",
    "NodeNameTaken",
    "QosEvent",
    "QosProfile",
    "QueueFull",
    "RegistrationRefused",
    "Reliability",
    "SimpleRosError",
    "TimerEvent",
    "TopicTypeMismatch",
    "TypeConflict",
    "TypeDefinitionConflict",
    "UnknownMessageType",
]


def __getattr__(name: str) -> str:
    if name == "__version__":
        # Reading the distribution's metadata takes longer than everything else here.
        from importlib.metadata import version

        return version("simple-ros")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
