"""The blocking face: nodes, publishers, subscribers and timers for programs without an event loop.

Everything forwards to the asyncio classes, which run on one background loop. Callbacks and timers run
in the thread that spins (`simple_ros.system_manager`), none before. What one read of a link brought
crosses to that thread in one piece.
"""

from simple_ros.blocking.action import ActionClient, ActionServer, ClientGoal, ServerGoal
from simple_ros.blocking.node import BlockingNode
from simple_ros.blocking.parameters import ParameterWatch
from simple_ros.blocking.publisher import Publisher
from simple_ros.blocking.service import ServiceClient, ServiceServer
from simple_ros.blocking.subscriber import Subscriber
from simple_ros.blocking.timer import Timer

__all__ = [
    "ActionClient",
    "ActionServer",
    "BlockingNode",
    "ClientGoal",
    "ParameterWatch",
    "Publisher",
    "ServerGoal",
    "ServiceClient",
    "ServiceServer",
    "Subscriber",
    "Timer",
]
