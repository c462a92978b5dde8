"""Transforms on the wire: who sends them, and who fills a `Buffer` with them."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from typing import Self

from simple_ros.clock import Clock
from simple_ros.msg.geometry_msgs import TransformStamped
from simple_ros.msg.tf2_msgs import TFMessage
from simple_ros.node import NodeHandle
from simple_ros.publisher import Publisher
from simple_ros.qos import LATCHED, QosProfile, Reliability
from simple_ros.sim_time import ClockChange
from simple_ros.subscriber import Subscriber
from simple_ros.tf.buffer import Buffer
from simple_ros.tf.checks import checked
from simple_ros.tf.errors import InvalidArgument

__all__ = ["StaticTransformBroadcaster", "TransformBroadcaster", "TransformListener"]

logger = logging.getLogger(__name__)

TF_TOPIC = "/tf"
TF_STATIC_TOPIC = "/tf_static"
TF_QOS = QosProfile(depth=100)
# Takes also what is sent with best effort, and from everybody latched who sends it so.
_LISTENER_QOS = QosProfile(depth=1000, reliability=Reliability.BEST_EFFORT)

Transforms = TransformStamped | Iterable[TransformStamped]


def _checked(transforms: Transforms) -> list[TransformStamped]:
    """One transform or many as a list, all of which a listener will take."""
    listed = [transforms] if isinstance(transforms, TransformStamped) else list(transforms)
    for transform in listed:
        checked(transform)
    return listed


class TransformBroadcaster:
    """Sends transforms on ``tf``. Made by `TransformBroadcaster.create`."""

    def __init__(self, publisher: Publisher[TFMessage]) -> None:
        self._publisher = publisher

    @classmethod
    async def create(cls, node: NodeHandle) -> Self:
        """A broadcaster of a node; returns when the Master knows its publisher.

        Raises as `simple_ros.aio.NodeHandle.advertise`.
        """
        return cls(await node.advertise(TF_TOPIC, TFMessage, qos=TF_QOS))

    def send(self, transforms: Transforms) -> None:
        """Send one transform or several, in one message.

        Raises:
            InvalidArgument: A transform makes no sense, see `BufferCore.set_transform`.
            HandleClosed: The broadcaster or its node is closed.
        """
        self._publisher.publish(TFMessage(transforms=_checked(transforms)))

    async def close(self) -> None:
        """Send no more."""
        await self._publisher.close()


class StaticTransformBroadcaster:
    """Sends transforms that never change on ``tf_static``, latched: who comes late gets them too.

    Made by `StaticTransformBroadcaster.create`.
    """

    def __init__(self, publisher: Publisher[TFMessage]) -> None:
        self._publisher = publisher
        self._sent: dict[str, TransformStamped] = {}

    @classmethod
    async def create(cls, node: NodeHandle) -> Self:
        """A broadcaster of a node; returns when the Master knows its publisher.

        Raises as `simple_ros.aio.NodeHandle.advertise`.
        """
        return cls(await node.advertise(TF_STATIC_TOPIC, TFMessage, qos=LATCHED))

    def send(self, transforms: Transforms) -> None:
        """Send one transform or several, together with all that were sent before.

        A further transform of the same child frame takes the place of the former.

        Raises:
            InvalidArgument: A transform makes no sense, see `BufferCore.set_transform`.
            HandleClosed: The broadcaster or its node is closed.
        """
        for transform in _checked(transforms):
            kept = TransformStamped()
            kept.CopyFrom(transform)
            self._sent[transform.child_frame_id.lstrip("/")] = kept
        self._publisher.publish(TFMessage(transforms=self._sent.values()))

    async def close(self) -> None:
        """Send no more; who has the transforms keeps them."""
        await self._publisher.close()


class TransformListener:
    """Fills a buffer with what comes on ``tf`` and ``tf_static``. Made by `TransformListener.create`.

    When simulated time goes back, the buffer forgets all but static transforms.

    Attributes:
        buffer: What it fills.
        refused: Transforms that made no sense; the first of each kind is logged.
    """

    def __init__(self, node: NodeHandle, buffer: Buffer) -> None:
        self.buffer = buffer
        self.refused = 0
        self._told: set[str] = set()
        self._clock = Clock.attach(node)
        self._subscribers: list[Subscriber[TFMessage]] = []

    @classmethod
    async def create(cls, node: NodeHandle, buffer: Buffer | None = None) -> Self:
        """A listener of a node; returns when the Master knows its subscriptions.

        Args:
            node: A started node.
            buffer: What to fill; None makes one.

        Raises as `simple_ros.aio.NodeHandle.subscribe`.
        """
        listener = cls(node, buffer or Buffer())
        await listener._start(node)
        return listener

    async def _start(self, node: NodeHandle) -> None:
        for topic, take in ((TF_TOPIC, self._moving), (TF_STATIC_TOPIC, self._static)):
            self._subscribers.append(
                await node.subscribe(topic, TFMessage, take, qos=_LISTENER_QOS)
            )
        self._clock.add_listener(self._clock_changed)

    def _moving(self, message: TFMessage) -> None:
        self._take(message, is_static=False)

    def _static(self, message: TFMessage) -> None:
        self._take(message, is_static=True)

    def _take(self, message: TFMessage, *, is_static: bool) -> None:
        for transform in message.transforms:
            try:
                self.buffer.set_transform(transform, is_static=is_static)
            except InvalidArgument as error:
                self._refuse(transform.child_frame_id, error)

    def _refuse(self, child: str, error: InvalidArgument) -> None:
        self.refused += 1
        if child not in self._told and len(self._told) < 100:
            self._told.add(child)
            logger.warning("a transform is left out: %s", error)

    def _clock_changed(self, change: ClockChange) -> None:
        if change.breaks:
            self.buffer.clear()

    async def close(self) -> None:
        """Listen no more; the buffer keeps what it has."""
        self._clock.remove_listener(self._clock_changed)
        for subscriber in self._subscribers:
            await subscriber.close()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()
