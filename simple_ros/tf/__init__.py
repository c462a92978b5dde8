"""Coordinate frames: who stands where in whom, over time (tf2).

::

    listener = await TransformListener.create(node)
    pose = await listener.buffer.wait_for_transform("map", "camera", timeout=2.0)

`simple_ros.tf.blocking` has the same for programs without an event loop.
"""

from simple_ros.tf.apply import do_transform, transform_points
from simple_ros.tf.buffer import Buffer
from simple_ros.tf.core import BufferCore, FrameFacts
from simple_ros.tf.errors import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgument,
    LookupException,
    TransformError,
    TransformTimeout,
)
from simple_ros.tf.nodes import StaticTransformBroadcaster, TransformBroadcaster, TransformListener
from simple_ros.tf.rigid import Rigid

__all__ = [
    "Buffer",
    "BufferCore",
    "ConnectivityException",
    "ExtrapolationException",
    "FrameFacts",
    "InvalidArgument",
    "LookupException",
    "Rigid",
    "StaticTransformBroadcaster",
    "TransformBroadcaster",
    "TransformError",
    "TransformListener",
    "TransformTimeout",
    "do_transform",
    "transform_points",
]
