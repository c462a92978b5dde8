"""What a program logs, on the topic ``rosout``.

::

    rosout = await enable_rosout(node, level="info")
    logging.getLogger(__name__).info("ready")

A log call never waits: it puts a line into a bounded queue, and the node's event loop sends it. Lines
that do not fit are counted and dropped.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from typing import Self

from simple_ros.blocking import BlockingNode
from simple_ros.faces import parts_of
from simple_ros.log_levels import LEVEL_NAMES, level_name, python_level, ros_level
from simple_ros.msg.rosgraph_msgs import Log
from simple_ros.net.loop import BackgroundLoop
from simple_ros.node import NodeHandle
from simple_ros.parameters.errors import ParameterConflict
from simple_ros.publisher import Publisher
from simple_ros.qos import QosProfile
from simple_ros.rosout import RosoutHandler, set_level

__all__ = [
    "BlockingRosout",
    "Rosout",
    "RosoutHandler",
    "enable_rosout",
    "enable_rosout_blocking",
    "set_level",
]

ROSOUT_TOPIC = "/rosout"
LEVEL_PARAMETER = "~log_level"
ROSOUT_QOS = QosProfile(depth=1000)


class Rosout:
    """A handler at work. Made by `enable_rosout`; close it to log no more."""

    def __init__(self, logger: logging.Logger, handler: RosoutHandler) -> None:
        self._logger = logger
        self._level_before = self._level_set = logger.level
        self._handler = handler
        self._publisher: Publisher[Log] | None = None
        self._watch: asyncio.Task[None] | None = None

    async def start(self, node: NodeHandle, level: int) -> None:
        """Attach the handler, then advertise (called by `enable_rosout`)."""
        self._set_level(level)
        self._logger.addHandler(self._handler)
        try:
            self._publisher = await node.advertise(ROSOUT_TOPIC, Log, qos=ROSOUT_QOS)
        except BaseException:
            self._detach()
            raise
        self._handler.sends_to(self._publisher)
        self._watch = asyncio.get_running_loop().create_task(self._until_end(node))

    async def _until_end(self, node: NodeHandle) -> None:
        try:
            await node.wait_ended()
        finally:
            self._detach()

    @property
    def dropped(self) -> int:
        """Lines that were not sent."""
        return self._handler.dropped

    async def wait_for_subscribers(self, count: int = 1, timeout: float | None = None) -> None:
        """Wait until so many listen; lines of before are heard by nobody.

        Raises:
            TimeoutError: Not within ``timeout`` seconds.
        """
        if self._publisher is not None:
            await self._publisher.wait_for_subscribers(count, timeout)

    def set_level(self, level: str | int) -> None:
        """Change from which level on lines are sent; the logger's own level falls if it must.

        Raises:
            ConfigError: There is no such level.
        """
        self._set_level(python_level(level))

    def _set_level(self, level: int) -> None:
        self._handler.setLevel(level)
        if self._logger.getEffectiveLevel() > level:
            self._logger.setLevel(level)
            self._level_set = level

    async def close(self) -> None:
        """Send what waits, then log no more on ``rosout``."""
        self._handler.flush_now()
        self._detach()
        if self._watch is not None:
            self._watch.cancel()
        if self._publisher is not None:
            await self._publisher.close()

    def _detach(self) -> None:
        if self._handler in self._logger.handlers:
            self._logger.removeHandler(self._handler)
            if self._logger.level == self._level_set:
                # Nobody else has changed it meanwhile.
                self._logger.setLevel(self._level_before)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()


async def enable_rosout(
    node: NodeHandle, *, level: str | int = "info", logger: str = "", capacity: int = 1000
) -> Rosout:
    """Send what a logger gets, and the loggers below it, on ``rosout`` under a node's name.

    The parameter ``~log_level`` changes the level (``simple-ros log set-level``). Ends with the node. Lines of before the Master is found wait, as far as they fit.

    Args:
        node: A started node.
        level: From which level on. A logger that would keep such records to itself is set to it, so
            other handlers may get more, too.
        logger: Name of the logger; empty is the root.
        capacity: Lines that may wait.

    Raises:
        ConfigError: There is no such level.
        TopicTypeMismatch: ``rosout`` carries another type.
        HandleClosed: The node is closed.
    """
    number = python_level(level)
    rosout = Rosout(logging.getLogger(logger), RosoutHandler(node, capacity))
    await rosout.start(node, number)
    node.on_parameter_changed(LEVEL_PARAMETER, lambda level: rosout.set_level(str(level)))
    # Somebody may have declared it already, in another way.
    with contextlib.suppress(ParameterConflict):
        await node.declare_parameter(
            LEVEL_PARAMETER,
            level_name(ros_level(number)),
            choices=LEVEL_NAMES,
            description="From which level on lines are sent on /rosout.",
        )
    return rosout


class BlockingRosout:
    """A handler at work. Made by `enable_rosout_blocking`; close it to log no more."""

    def __init__(self, loop: BackgroundLoop, rosout: Rosout) -> None:
        self._loop = loop
        self._rosout = rosout

    @property
    def dropped(self) -> int:
        """Lines that were not sent."""
        return self._rosout.dropped

    def wait_for_subscribers(self, count: int = 1, timeout: float | None = None) -> None:
        """Wait until so many listen; see `Rosout.wait_for_subscribers`."""
        self._loop.run(self._rosout.wait_for_subscribers(count, timeout))

    def set_level(self, level: str | int) -> None:
        """Change from which level on lines are sent; see `Rosout.set_level`."""
        self._rosout.set_level(level)

    def close(self) -> None:
        """Send what waits, then log no more on ``rosout``."""
        self._loop.run(self._rosout.close())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def enable_rosout_blocking(
    node: BlockingNode, *, level: str | int = "info", logger: str = "", capacity: int = 1000
) -> BlockingRosout:
    """As `enable_rosout`, for a blocking node."""
    loop, inner = parts_of(node)
    enabled = enable_rosout(inner, level=level, logger=logger, capacity=capacity)
    return BlockingRosout(loop, loop.run(enabled))
