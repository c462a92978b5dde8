"""Launch files and what runs them.

`describe` reads a launch file; `Supervisor` runs processes for programs of any kind; `Launcher` is what
``simple-ros launch`` does with both. Launch files in Python are written with
`simple_ros.launch.entries`.
"""

from simple_ros.launch.description import (
    LaunchDescription,
    Limits,
    LogTo,
    ProcessDescription,
    Ready,
    ReadyWhen,
)
from simple_ros.launch.errors import LaunchFailed, LaunchFileError, Place, UnknownProcess
from simple_ros.launch.events import (
    Ended,
    Exit,
    GivenUp,
    IsReady,
    NotReady,
    ProcessEvent,
    Restarting,
    Started,
    Stopping,
)
from simple_ros.launch.files import arguments_of, describe
from simple_ros.launch.launcher import Launcher, MasterChoice
from simple_ros.launch.plan import State, Status, Verdict
from simple_ros.launch.restart import Respawn
from simple_ros.launch.supervisor import Supervisor

__all__ = [
    "Ended",
    "Exit",
    "GivenUp",
    "IsReady",
    "LaunchDescription",
    "LaunchFailed",
    "LaunchFileError",
    "Launcher",
    "Limits",
    "LogTo",
    "MasterChoice",
    "NotReady",
    "Place",
    "ProcessDescription",
    "ProcessEvent",
    "Ready",
    "ReadyWhen",
    "Respawn",
    "Restarting",
    "Started",
    "State",
    "Status",
    "Stopping",
    "Supervisor",
    "UnknownProcess",
    "Verdict",
    "arguments_of",
    "describe",
]
