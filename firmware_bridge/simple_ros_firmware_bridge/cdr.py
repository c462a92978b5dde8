"""Samples of ROS 2 as protobuf messages, and back: plain CDR (XCDR1) without encapsulation header.

Everything is aligned to its own size, counted from the first byte. What lies at fixed distances is read
by one `struct` call, however deep it is nested: a Twist is one call, an Imu two and its frame name.
"""

from __future__ import annotations

import struct
from functools import cache
from typing import Any, TypeVar

from google.protobuf.descriptor import Descriptor
from google.protobuf.message import Message

from simple_ros.errors import SimpleRosError
from simple_ros_firmware_bridge import cdr_plan

__all__ = ["CdrError", "decode", "encode", "prepare"]

MessageT = TypeVar("MessageT", bound=Message)


class CdrError(SimpleRosError, ValueError):
    """Bytes are no sample of the type, or a message cannot be written as one.

    Attributes:
        type_name: Full name of the message.
        reason: What is wrong.
    """

    def __init__(self, type_name: str, reason: str) -> None:
        self.type_name = type_name
        self.reason = reason
        super().__init__(f"{type_name}: {reason}")


@cache
def _plan(descriptor: Descriptor) -> cdr_plan.Plan:
    return cdr_plan.plan_of(descriptor)


def prepare(message_class: type[Message]) -> None:
    """Plan a type now, so that its first sample does not wait for that."""
    _plan(message_class.DESCRIPTOR)


def decode(data: bytes, message_class: type[MessageT], order: str = "<") -> MessageT:
    """A sample as a message.

    Members at the end that the sender's version of the type does not have keep their defaults
    (``Range.variance`` of Humble); what follows the last member is ignored.

    Args:
        data: The sample.
        message_class: What it is.
        order: ``<`` little endian, ``>`` big endian.

    Raises:
        CdrError: The bytes end within a member, or a value is impossible.
    """
    message = message_class()
    cursor = cdr_plan.Cursor(data, order)
    try:
        _plan(message_class.DESCRIPTOR).decode(cursor, message)
    except (cdr_plan.Impossible, struct.error, ValueError, TypeError) as error:
        raise CdrError(message_class.DESCRIPTOR.full_name, str(error)) from None
    return message


def encode(message: Any, order: str = "<") -> bytes:
    """A message as a sample.

    Args:
        message: The message.
        order: ``<`` little endian, ``>`` big endian.

    Raises:
        CdrError: A number is too large for its place, or an array too long.
    """
    out = bytearray()
    try:
        _plan(message.DESCRIPTOR).encode(out, message, order)
    except (cdr_plan.Impossible, struct.error, ValueError, TypeError) as error:
        raise CdrError(message.DESCRIPTOR.full_name, str(error)) from None
    return bytes(out)
