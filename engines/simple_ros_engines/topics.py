"""Topics of the engines: messages numbered by their publisher, watched by who takes them."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, Generic, TypeVar

from google.protobuf.message import Message

from simple_ros.msg.wireless_ros_msgs import TopicFlow
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher
from simple_ros.qos import QosProfile
from simple_ros_engines.flow import SequenceWatch

__all__ = ["NAMESPACE", "Inlet", "Outlet", "no_numbers", "outlet"]

NAMESPACE = "wireless_ros"
MessageT = TypeVar("MessageT", bound=Message)


class Outlet(Generic[MessageT]):
    """A publisher that numbers its messages.

    Args:
        publisher: Of a message with a header.
    """

    def __init__(self, publisher: Publisher[MessageT]) -> None:
        self._publisher = publisher
        self._seq = 0

    @property
    def is_heard(self) -> bool:
        """Whether anybody listens."""
        return self._publisher.subscriber_count > 0

    def publish(self, message: MessageT) -> None:
        """Number and send."""
        header: Any = getattr(message, "header")  # noqa: B009
        header.seq = self._seq
        self._seq = (self._seq + 1) & 0xFFFFFFFF
        self._publisher.publish(message)


class Inlet(Generic[MessageT]):
    """Takes messages that an `Outlet` numbered, leaves out what came before, and counts what is missing.

    Args:
        topic: Its name.
        callback: Called with each message that is new.
    """

    def __init__(self, topic: str, callback: Callable[[MessageT], None]) -> None:
        self.watch = SequenceWatch()
        self._topic = topic
        self._callback = callback
        self._told = (0, time.monotonic())

    def came(self, message: MessageT) -> None:
        """A message of the topic."""
        header: Any = getattr(message, "header")  # noqa: B009
        stamp_ns = header.stamp.ToNanoseconds()
        if not header.seq and not stamp_ns:
            # Of a publisher that does not number, such as a person at the command line.
            self.watch.received += 1
            self._callback(message)
        elif self.watch.came(header.seq, stamp_ns):
            self._callback(message)

    def flow(self) -> TopicFlow:
        """What came, and how often since this was asked the last time."""
        watch, now_s = self.watch, time.monotonic()
        before, before_s = self._told
        self._told = (watch.received, now_s)
        return TopicFlow(
            topic=self._topic,
            received=watch.received,
            gaps=watch.gaps,
            duplicates=watch.duplicates,
            rate_hz=(watch.received - before) / max(1e-3, now_s - before_s),
        )


def no_numbers(message: Message) -> list[str]:
    """Fields of a message that hold a float and no number, or an infinite one."""
    return [
        field.name
        for field, value in message.ListFields()
        if isinstance(value, float) and not math.isfinite(value)
    ]


async def outlet(
    node: NodeHandle, topic: str, message_class: type[MessageT], depth: int = 10
) -> Outlet[MessageT]:
    """A numbered publisher below the engines' namespace."""
    publisher = await node.advertise(
        f"/{NAMESPACE}/{topic}", message_class, qos=QosProfile(depth=depth)
    )
    return Outlet(publisher)
