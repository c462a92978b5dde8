"""A board's readers and writers on a node, without a line and without a graph."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, cast

import pytest
from support.waiting import until

from simple_ros.aio import NodeHandle
from simple_ros.msg.geometry_msgs import TransformStamped, Twist, Vector3
from simple_ros.msg.tf2_msgs import TFMessage
from simple_ros_firmware_bridge import cdr
from simple_ros_firmware_bridge.endpoints import BoardEndpoints
from simple_ros_firmware_bridge.mapping import TopicMap
from simple_ros_firmware_bridge.xrce.creation import ObjectId
from simple_ros_firmware_bridge.xrce.events import Endpoint, ReaderReady, Sample, WriterReady

TWIST = "geometry_msgs::msg::dds_::Twist_"
WRITER = ObjectId(b"\x00\x15")
READER = ObjectId(b"\x00\x16")


class Node:
    """What `BoardEndpoints` uses of a node."""

    def __init__(self) -> None:
        self.callback: Callable[[Any], None] | None = None

    async def subscribe(self, _topic: str, _type: Any, callback: Any, **_: Any) -> Node:
        self.callback = callback
        return self

    async def advertise(self, *_: Any, **__: Any) -> Node:
        return self

    async def close(self) -> None:
        """Nothing is open."""


def twist(x: float) -> Twist:
    return Twist(linear=Vector3(x=x))


@pytest.mark.parametrize("is_reliable", [False, True])
async def test_what_a_full_line_keeps_waiting_does_not_grow_old(is_reliable: bool) -> None:
    node, is_full, sent = Node(), True, []
    endpoints = BoardEndpoints(
        cast("NodeHandle", node),
        TopicMap(),
        lambda _, data, topic: sent.append((topic, cdr.decode(data, Twist).linear.x)),
        lambda: is_full,
    )
    endpoints.take(ReaderReady(Endpoint(READER, "rt/cmd_vel", TWIST, is_reliable)))
    await until(lambda: node.callback is not None, "a subscription")
    assert node.callback is not None
    for x in (1.0, 2.0, 3.0):
        node.callback(twist(x))
    if is_reliable:  # its window is counted elsewhere
        assert [x for _, x in sent] == [1.0, 2.0, 3.0]
    else:
        assert sent == []
        is_full = False
        await until(lambda: bool(sent), "the newest")
        assert sent == [("cmd_vel", 3.0)]
    await endpoints.close()


async def test_stamps_of_transforms_are_replaced_too() -> None:
    endpoints = BoardEndpoints(cast("NodeHandle", Node()), TopicMap(), lambda *_: None)
    name = "tf2_msgs::msg::dds_::TFMessage_"
    endpoints.take(WriterReady(Endpoint(WRITER, "rt/tf", name)))
    data = cdr.encode(TFMessage(transforms=[TransformStamped(child_frame_id="base_link")] * 2))
    endpoints.take(Sample(WRITER, data, "<"))
    (message,) = endpoints.flows[WRITER].early
    stamps = [item.header.stamp.seconds for item in cast("TFMessage", message).transforms]
    assert stamps == pytest.approx([time.time()] * 2, abs=60)
    await endpoints.close()
