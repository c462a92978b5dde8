"""The messages that are sent: each made anew, numbered from 1 and stamped, as a program would.

Number 0 is a warm-up that receivers do not count.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from struct import Struct
from typing import Any

from simple_ros.benchmark.workloads import Workload

__all__ = ["HEAD", "encoder", "image_fields", "image_maker", "raw_maker", "twist_maker"]

HEAD = Struct(">Qd")
"""How a raw message begins: number and stamp."""

_COLUMNS = 1920


def twist_maker(workload: Workload) -> Callable[[int], Any]:
    """Makes the Twist of a number: six doubles, stamped where latency is measured."""
    from simple_ros.msg.geometry_msgs_pb2 import Twist

    is_timed = bool(workload.rate_hz)
    clock = time.monotonic

    def make(number: int) -> Twist:
        twist = Twist()
        linear, angular = twist.linear, twist.angular
        linear.x, linear.y, linear.z = number, 2.2, 3.3
        angular.x, angular.y = 4.4, 5.5
        angular.z = clock() if is_timed else 6.6
        return twist

    return make


def image_fields(workload: Workload) -> Callable[[int], Any]:
    """Makes the Image of a number, without its pixels."""
    from simple_ros.msg.sensor_msgs_pb2 import Image

    step = _COLUMNS * 3
    height = workload.size_bytes // step

    def make(number: int) -> Image:
        image = Image(height=height, width=_COLUMNS, encoding="rgb8", step=step)
        image.header.seq = number
        stamp_ns = time.monotonic_ns()
        stamp = image.header.stamp
        stamp.seconds, stamp.nanos = stamp_ns // 10**9, stamp_ns % 10**9
        return image

    return make


def image_maker(workload: Workload) -> Callable[[int], Any]:
    """Makes the Image of a number, pixels and all, as one protobuf object."""
    fields = image_fields(workload)
    pixels = bytes(workload.size_bytes)

    def make(number: int) -> Any:
        image = fields(number)
        image.data = pixels
        return image

    return make


def encoder(workload: Workload) -> Callable[[int], bytes]:
    """Makes the message of a number and serialises it."""
    make = twist_maker(workload) if workload.shape == "twist" else image_maker(workload)

    def encode(number: int) -> bytes:
        data: bytes = make(number).SerializeToString()
        return data

    return encode


def raw_maker(workload: Workload) -> Callable[[int], bytearray]:
    """Writes number and stamp at the beginning of a buffer of the size, always the same one."""
    buffer = bytearray(max(workload.size_bytes, HEAD.size))
    pack, clock = HEAD.pack_into, time.monotonic

    def make(number: int) -> bytearray:
        pack(buffer, 0, number, clock())
        return buffer

    return make
