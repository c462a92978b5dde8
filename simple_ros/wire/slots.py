"""What two processes write about memory they share: who still looks at which slot, and where a message lies.

The memory of a publishing process is one file without a name. It begins with a table of flags, one byte each, so
that nobody ever changes a byte that another changes::

    held[slot][reader]       1 while a view of the slot's content may exist; cleared by the reader
    in_flight[slot][reader]  1 until the reader has handed the message on; cleared by the reader
    wanted[reader]           1 while the writer waits to be told that something was cleared

Behind it lie the slots. Each holds whole frames, as they would stand in the stream. In their place the
stream brings a frame that says where they lie.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from simple_ros.errors import FrameError
from simple_ros.names import MAX_NAME_BYTES
from simple_ros.wire.framing import Run, encode_header

__all__ = [
    "MOST_READERS",
    "MOST_SLOTS",
    "SLOT_HEADER",
    "TABLE_BYTES",
    "SlotRef",
    "frames_in",
    "held_at",
    "in_flight_at",
    "slot_capacity",
    "wanted_at",
]

MOST_SLOTS = 64
MOST_READERS = 64
TABLE_BYTES = 64 * 1024
"""Where the slots begin: the table, rounded up to whole pages, which are of 64 KiB on some systems."""
SLOT_HEADER = encode_header("", "__shared_memory_slot")
"""What begins a frame that stands for others."""

_IN_FLIGHT = MOST_SLOTS * MOST_READERS
_WANTED = 2 * _IN_FLIGHT
_LEAST_SLOT = 64 * 1024
_REF = struct.Struct(">IQQQ")
_U16 = struct.Struct(">H")
_U32 = struct.Struct(">I")


def held_at(slot: int, reader: int = 0) -> int:
    """Where the flag stands; the flags of a slot's readers follow each other."""
    return slot * MOST_READERS + reader


def in_flight_at(slot: int, reader: int) -> int:
    """Where the flag stands."""
    return _IN_FLIGHT + slot * MOST_READERS + reader


def wanted_at(reader: int) -> int:
    """Where the flag stands."""
    return _WANTED + reader


def slot_capacity(size: int) -> int:
    """How large a slot is made for ``size`` bytes: a bit more, so that the next message fits too."""
    step = max(_LEAST_SLOT, 1 << max(0, size.bit_length() - 3))
    return -(-size // step) * step


class SlotRef(NamedTuple):
    """Where frames lie.

    Attributes:
        slot: Number of the slot.
        offset: Where it begins in the file, in bytes.
        capacity: Its size, in bytes.
        size: How much of it is used, in bytes.
    """

    slot: int
    offset: int
    capacity: int
    size: int

    def frame(self) -> bytes:
        """The frame that stands for what lies there."""
        payload = _REF.pack(*self)
        return SLOT_HEADER + _U32.pack(len(payload)) + payload

    @classmethod
    def parse(cls, payload: bytes | memoryview) -> SlotRef:
        """Read the payload of such a frame.

        Raises:
            FrameError: It is none.
        """
        try:
            ref = cls(*_REF.unpack(payload))
        except struct.error:
            raise FrameError(f"{len(payload)} bytes do not name a slot") from None
        if ref.slot >= MOST_SLOTS or ref.size > ref.capacity or ref.offset < TABLE_BYTES:
            raise FrameError(f"no such slot: {ref}")
        return ref


def frames_in(data: memoryview, max_message_bytes: int) -> list[Run]:
    """The frames that lie in a slot; nothing is copied.

    Args:
        data: The used part of the slot.
        max_message_bytes: Larger messages are reported as oversized.

    Raises:
        FrameError: The bytes are not whole frames.
    """
    runs: list[Run] = []
    position = 0
    try:
        while position < len(data):
            begin = position
            for _ in range(2):
                (length,) = _U16.unpack_from(data, position)
                if length > MAX_NAME_BYTES:
                    raise FrameError(f"a name of {length} bytes is announced in a slot")
                position += 2 + length
            header = bytes(data[begin:position])
            (size,) = _U32.unpack_from(data, position)
            position += 4 + size
            payload = data[position - size : position]
            if len(payload) < size:
                raise FrameError("a slot ends inside a frame")
            if size > max_message_bytes:
                runs.append(Run(header, [], size))
            else:
                runs.append(Run(header, [payload]))
    except struct.error:
        raise FrameError("a slot ends inside a frame") from None
    return runs
