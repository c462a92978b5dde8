"""What an agent tells about its board."""

from __future__ import annotations

from dataclasses import dataclass

from simple_ros_firmware_bridge.xrce.creation import ObjectId

__all__ = [
    "Endpoint",
    "EndpointGone",
    "EndpointRefused",
    "Event",
    "ReaderReady",
    "Sample",
    "ServiceCalled",
    "ServiceOffered",
    "ServiceReplied",
    "ServiceWanted",
    "SessionClosed",
    "SessionOpened",
    "SessionResumed",
    "WriterReady",
]


@dataclass(frozen=True)
class Endpoint:
    """A reader or writer of a board.

    Attributes:
        object_id: Its id.
        topic: As the board wrote it: ``rt/odom``.
        type_name: As the board wrote it: ``nav_msgs::msg::dds_::Odometry_``.
        reliable: Whether it asked for reliable delivery.
        transient: Whether it keeps messages for late readers.
        reply_type: Of a service; its ``topic`` is the service's name, its ``type_name`` the request's.
    """

    object_id: ObjectId
    topic: str
    type_name: str
    reliable: bool = True
    transient: bool = False
    reply_type: str = ""


@dataclass(frozen=True)
class Event:
    """Something happened."""


@dataclass(frozen=True)
class SessionOpened(Event):
    """A board connected.

    Attributes:
        key: Its client key, as hexadecimal digits.
        is_same: Whether the same board was connected before; its objects are kept.
    """

    key: str
    is_same: bool


@dataclass(frozen=True)
class SessionResumed(Event):
    """A board that never noticed that we were away is heard again."""

    key: str


@dataclass(frozen=True)
class SessionClosed(Event):
    """The session is over; every endpoint of it is gone.

    Attributes:
        reason: Why, in words.
    """

    reason: str


@dataclass(frozen=True)
class WriterReady(Event):
    """The board will publish."""

    endpoint: Endpoint


@dataclass(frozen=True)
class ReaderReady(Event):
    """The board wants samples of a topic."""

    endpoint: Endpoint


@dataclass(frozen=True)
class EndpointGone(Event):
    """The board deleted a reader or writer, or does not want samples any more."""

    object_id: ObjectId


@dataclass(frozen=True)
class EndpointRefused(Event):
    """A reader or writer could not be made; the board was told.

    Attributes:
        reason: Why, in words.
    """

    reason: str


@dataclass(frozen=True)
class Sample(Event):
    """The board published.

    Attributes:
        writer: Which writer.
        data: Plain CDR, without encapsulation header.
        order: Its byte order, ``<`` or ``>``.
    """

    writer: ObjectId
    data: bytes
    order: str


@dataclass(frozen=True)
class ServiceOffered(Event):
    """The board provides a service and is ready for requests."""

    endpoint: Endpoint


@dataclass(frozen=True)
class ServiceWanted(Event):
    """The board will call a service."""

    endpoint: Endpoint


@dataclass(frozen=True)
class ServiceCalled(Event):
    """The board calls a service.

    Attributes:
        requester: Which of its requesters.
        call: Its number for the call, to be given back with the reply.
        data: The request, plain CDR.
        order: Its byte order.
    """

    requester: ObjectId
    call: bytes
    data: bytes
    order: str


@dataclass(frozen=True)
class ServiceReplied(Event):
    """The board answers a request.

    Attributes:
        replier: Which of its services.
        call: The number that the request had.
        data: The reply, plain CDR.
        order: Its byte order.
    """

    replier: ObjectId
    call: int
    data: bytes
    order: str
