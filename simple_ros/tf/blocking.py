"""Broadcasters and listener for programs without an event loop.

A listener is fed on the background loop, so that a callback may wait for a transform in the very thread
that spins.
"""

from __future__ import annotations

from typing import Self

from simple_ros.blocking import BlockingNode
from simple_ros.faces import parts_of
from simple_ros.msg.geometry_msgs import TransformStamped
from simple_ros.net.loop import BackgroundLoop
from simple_ros.tf import nodes
from simple_ros.tf.buffer import Buffer
from simple_ros.tf.nodes import Transforms
from simple_ros.time import Time

__all__ = ["StaticTransformBroadcaster", "TransformBroadcaster", "TransformListener"]


_Sender = nodes.TransformBroadcaster | nodes.StaticTransformBroadcaster


class _Broadcaster:
    """Sends from any thread."""

    def __init__(self, loop: BackgroundLoop, inner: _Sender) -> None:
        self._loop = loop
        self._inner = inner

    def send(self, transforms: Transforms) -> None:
        """Send one transform or several.

        Raises:
            InvalidArgument: A transform makes no sense, see `BufferCore.set_transform`.
            HandleClosed: The broadcaster or its node is closed.
        """

        async def send() -> None:
            self._inner.send(transforms)

        self._loop.run(send())

    def close(self) -> None:
        """Send no more."""
        self._loop.run(self._inner.close())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class TransformBroadcaster(_Broadcaster):
    """Sends transforms on ``tf``."""

    def __init__(self, node: BlockingNode) -> None:
        loop, inner = parts_of(node)
        super().__init__(loop, loop.run(nodes.TransformBroadcaster.create(inner)))


class StaticTransformBroadcaster(_Broadcaster):
    """Sends transforms that never change on ``tf_static``, latched: who comes late gets them too."""

    def __init__(self, node: BlockingNode) -> None:
        loop, inner = parts_of(node)
        super().__init__(loop, loop.run(nodes.StaticTransformBroadcaster.create(inner)))


class TransformListener:
    """Fills a buffer with what comes on ``tf`` and ``tf_static``, also while nobody spins.

    Args:
        node: A blocking node.
        buffer: What to fill; None makes one.

    Attributes:
        buffer: What it fills.
    """

    def __init__(self, node: BlockingNode, buffer: Buffer | None = None) -> None:
        self.buffer = buffer or Buffer()
        self._loop: BackgroundLoop
        self._loop, inner = parts_of(node)
        self._inner = self._loop.run(nodes.TransformListener.create(inner, self.buffer))

    @property
    def refused(self) -> int:
        """Transforms that made no sense."""
        return self._inner.refused

    def wait_for_transform(
        self, target: str, source: str, time: Time | None = None, timeout: float = 1.0
    ) -> TransformStamped:
        """A transform, waiting until it is known; see `Buffer.wait_for_transform`."""
        return self.buffer.wait_for_transform_blocking(target, source, time, timeout)

    def close(self) -> None:
        """Listen no more; the buffer keeps what it has."""
        self._loop.run(self._inner.close())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
