"""The asyncio face of simple_ros: nodes, publishers, subscribers and timers on an event loop.

::

    from simple_ros import aio
    from simple_ros.msg.std_msgs import String

    async def main():
        async with aio.NodeHandle("talker") as node:
            publisher = await node.advertise("chatter", String)
            node.create_timer(0.1, lambda event: publisher.publish(String(data="hello")))
            await node.spin()

    aio.run(main())
"""

from __future__ import annotations

import asyncio
import signal
import threading
from collections.abc import Coroutine
from typing import Any, TypeVar

from simple_ros.actions.client import ActionClient
from simple_ros.actions.client_goal import ClientGoal, GoalOutcome
from simple_ros.actions.goal import ServerGoal
from simple_ros.actions.server import ActionServer
from simple_ros.actions.states import GoalState
from simple_ros.arguments import BadArgument
from simple_ros.errors import NodeNameTaken
from simple_ros.net.loop import NoSuchLoop, new_loop
from simple_ros.net.master_client import MasterClient
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher, PublisherStatistics
from simple_ros.schedule import TimerEvent
from simple_ros.service_client import ServiceClient
from simple_ros.service_server import ServiceServer, ServiceStatistics
from simple_ros.subscriber import Subscriber, SubscriberStatistics
from simple_ros.timers import Timer
from simple_ros.wire.calls import AdaptiveTimeout

__all__ = [
    "ActionClient",
    "ActionServer",
    "AdaptiveTimeout",
    "ClientGoal",
    "GoalOutcome",
    "GoalState",
    "MasterClient",
    "NodeHandle",
    "Publisher",
    "PublisherStatistics",
    "ServerGoal",
    "ServiceClient",
    "ServiceServer",
    "ServiceStatistics",
    "Subscriber",
    "SubscriberStatistics",
    "Timer",
    "TimerEvent",
    "new_loop",
    "run",
]

Result = TypeVar("Result")


def run(main: Coroutine[Any, Any, Result]) -> Result | None:
    """Run a program until it ends or is asked to end.

    On SIGINT or SIGTERM ``main`` is cancelled, so that its ``async with`` blocks say goodbye, and
    None is returned. A second signal while it does changes nothing. (Signals only reach a program's
    main thread; elsewhere this only runs ``main``.) ``SIMPLE_ROS_LOOP`` chooses
    the event loop (`new_loop`).

    Raises:
        SystemExit: A newer node took this one's name, or a word of the command line makes no sense
            (`BadArgument`), and ``main`` let that pass; or there is no such event loop: the program
            ends with its text on stderr, and exit code 1.
    """
    try:
        with asyncio.Runner(loop_factory=new_loop) as runner:
            return runner.run(_until_signal(main))
    except NoSuchLoop as error:
        main.close()
        raise SystemExit(str(error)) from None
    except (NodeNameTaken, BadArgument) as error:
        raise SystemExit(str(error)) from None


async def _until_signal(main: Coroutine[Any, Any, Result]) -> Result | None:
    loop = asyncio.get_running_loop()
    task = loop.create_task(main)
    stopped = False

    def stop() -> None:
        nonlocal stopped
        if not stopped:
            stopped = True
            task.cancel()

    on_main = threading.current_thread() is threading.main_thread()
    signals = (signal.SIGINT, signal.SIGTERM) if on_main else ()
    for number in signals:
        loop.add_signal_handler(number, stop)
    try:
        return await task
    except asyncio.CancelledError:
        if stopped and task.cancelled():
            return None
        raise
    finally:
        for number in signals:
            loop.remove_signal_handler(number)
