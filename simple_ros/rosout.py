"""From log records to messages: the handler that sends what a program logs on ``rosout``."""

from __future__ import annotations

import asyncio
import logging
import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from simple_ros.clock import Clock
from simple_ros.errors import SimpleRosError
from simple_ros.log_levels import python_level, ros_level
from simple_ros.msg.rosgraph_msgs import Log
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher
from simple_ros.time import Time

__all__ = ["MAX_TEXT", "RosoutHandler", "set_level"]

MAX_TEXT = 16_384

_OUR_LOGGERS = "simple_ros"
_MASTER_LOGGERS = "simple_ros_master"

# Set while lines are sent, and in all that the event loop does because of it, such as calling a
# subscription to rosout in this process: what is logged there would be sent, and logged, forever.
_sending: ContextVar[bool] = ContextVar("simple_ros_rosout_sending", default=False)


def set_level(level: str | int, logger: str = "") -> None:
    """Change at run time from which level on a logger's records count, for every handler.

    Args:
        level: ``debug``, ``info``, ``warn``, ``error`` or ``fatal``, or a number of `logging`.
        logger: Name of the logger; empty is the root, and changes the handlers of ``rosout`` too.

    Raises:
        ConfigError: There is no such level.
    """
    number = python_level(level)
    found = logging.getLogger(logger)
    found.setLevel(number)
    if found is logging.getLogger():
        for handler in found.handlers:
            if isinstance(handler, RosoutHandler):
                handler.setLevel(number)


class RosoutHandler(logging.Handler):
    """Hands log records to a node, which sends them on ``rosout``. May be used from any thread.

    Records of simple_ros itself count from WARNING on: what it logs about every message would
    otherwise be one more message.

    Args:
        node: A started node; the handler belongs to its event loop.
        capacity: Lines that may wait.

    Attributes:
        dropped: Lines that found the queue full or the node ended.
    """

    def __init__(self, node: NodeHandle, capacity: int = 1000) -> None:
        super().__init__()
        self.dropped = 0
        self._node = node
        self._clock = Clock.attach(node)
        self._loop = asyncio.get_running_loop()
        self._waiting: deque[Log] = deque()
        self._capacity = capacity
        self._publisher: Publisher[Log] | None = None
        self._scheduled = False
        self._closed = False
        self._seq = 0
        self._told_dropped = 0
        self._guard = threading.Lock()

    # -- any thread ----------------------------------------------------------------------------

    def emit(self, record: logging.LogRecord) -> None:
        """Queue a record; called by `logging`."""
        self._keep_last_resort(record)
        if _sending.get() or not _counts(record):
            return
        try:
            line = self._line(record)
        except Exception:
            self.handleError(record)
            return
        with self._guard:
            if self._closed or len(self._waiting) >= self._capacity:
                self.dropped += 1
                return
            self._waiting.append(line)
            if self._scheduled:
                return
            self._scheduled = True
        try:
            self._loop.call_soon_threadsafe(self._send)
        except RuntimeError:
            # The loop is closed: the node is gone, and nobody will ever send this.
            self._give_up()

    def _keep_last_resort(self, record: logging.LogRecord) -> None:
        """Print warnings of a program that has set up no logging, as `logging` does without us."""
        handlers = _handlers_of(record)
        others = any(not isinstance(handler, RosoutHandler) for handler in handlers)
        last = logging.lastResort
        if others or handlers[:1] != [self] or last is None:
            return
        if record.levelno >= last.level:
            last.handle(record)

    def _line(self, record: logging.LogRecord) -> Log:
        text = record.getMessage()
        if record.exc_info:
            text += "\n" + (self.formatter or logging.Formatter()).formatException(record.exc_info)
        stamp = self._clock.now() if self._clock.is_sim else Time.of(record.created)
        line = Log(
            level=ros_level(record.levelno),
            name=self._node.name,
            msg=_encodable(text if len(text) <= MAX_TEXT else text[:MAX_TEXT] + " ..."),
            file=_encodable(record.pathname),
            function=record.funcName or "",
            line=record.lineno,
        )
        line.header.stamp.CopyFrom(stamp.to_msg())
        return line

    # -- the node's event loop -----------------------------------------------------------------

    def sends_to(self, publisher: Publisher[Log]) -> None:
        """Send what waits, and all that comes, by a publisher."""
        self._publisher = publisher
        self._send()

    def _send(self) -> None:
        with self._guard:
            self._scheduled = False
            if self._publisher is None:
                return
            lines = list(self._waiting)
            self._waiting.clear()
            missing = self.dropped - self._told_dropped
            self._told_dropped = self.dropped
        with _no_feedback():
            try:
                for line in lines:
                    self._publish(self._publisher, line)
                if missing:
                    self._publish(self._publisher, self._about_missing(missing))
            except SimpleRosError:
                self._give_up(len(lines))

    def _publish(self, publisher: Publisher[Log], line: Log) -> None:
        self._seq += 1
        line.header.seq = self._seq
        line.topics.extend(sorted({known.topic for known in self._node.endpoints.publishers}))
        publisher.publish(line)

    def _about_missing(self, count: int) -> Log:
        line = Log(level=Log.WARN, name=self._node.name, msg=f"{count} log lines were dropped here")
        line.header.stamp.CopyFrom(self._clock.now().to_msg())
        return line

    def _give_up(self, more: int = 0) -> None:
        with self._guard:
            self._closed = True
            self.dropped += len(self._waiting) + more
            self._waiting.clear()

    def flush_now(self) -> None:
        """Send what waits now, on the event loop."""
        self._send()


@contextmanager
def _no_feedback() -> Iterator[None]:
    token = _sending.set(True)
    try:
        yield
    finally:
        _sending.reset(token)


def _counts(record: logging.LogRecord) -> bool:
    ours = record.name.partition(".")[0] in (_OUR_LOGGERS, _MASTER_LOGGERS)
    return not ours or record.levelno >= logging.WARNING


def _handlers_of(record: logging.LogRecord) -> list[logging.Handler]:
    found: list[logging.Handler] = []
    logger: logging.Logger | None = logging.getLogger(record.name)
    while logger is not None:
        found += logger.handlers
        logger = logger.parent if logger.propagate else None
    return found


def _encodable(text: str) -> str:
    return text.encode("utf-8", "backslashreplace").decode()
