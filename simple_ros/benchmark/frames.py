"""Length-prefixed messages cut from a buffer, for the bare programs. No input, no output."""

from __future__ import annotations

from collections.abc import Callable
from struct import Struct
from typing import Any

from simple_ros.benchmark.sink import Sink

__all__ = ["LENGTH", "FrameReader", "large_taker"]

LENGTH = Struct(">I")
_BUFFER_BYTES = 256 * 1024


class FrameReader:
    """Takes bytes where it says, hands out messages as views that are valid during the call.

    Args:
        take: Called with each message.
    """

    def __init__(self, take: Callable[[Any], None]) -> None:
        self._take = take
        self._view = memoryview(bytearray(_BUFFER_BYTES))
        self._end = 0

    def room(self) -> memoryview:
        """Where the next bytes belong."""
        return self._view[self._end :]

    def received(self, count: int) -> None:
        """So many bytes were put there."""
        take, unpack, view = self._take, LENGTH.unpack_from, self._view
        position, end, wanted = 0, self._end + count, 0
        while end - position >= 4:
            (size,) = unpack(view, position)
            start = position + 4
            if end - start < size:
                wanted = size + 4
                break
            position = start + size
            take(view[start:position])
        self._keep(position, end, wanted)

    def _keep(self, position: int, end: int, wanted: int) -> None:
        rest = end - position
        if wanted > len(self._view):
            larger = memoryview(bytearray(wanted + _BUFFER_BYTES))
            larger[:rest] = self._view[position:end]
            self._view = larger
        elif position and rest:
            self._view[:rest] = self._view[position:end]
        self._end = rest


def large_taker(sink: Sink) -> Callable[[Any], None]:
    """A callback for serialised Images whose pixels stay where they were received."""
    from simple_ros.msg.sensor_msgs_pb2 import Image
    from simple_ros.protobuf_wire import split_field

    number = Image.DESCRIPTOR.fields_by_name["data"].number

    def take(data: memoryview) -> None:
        rest, pixels = split_field(data, number)
        image = Image.FromString(rest)
        stamp = image.header.stamp
        sink.pixels(image.header.seq, stamp.seconds + stamp.nanos / 1e9, pixels)

    return take
