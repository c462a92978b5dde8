"""Service calls as bytes and as state.

A client dials the provider's port, where topics arrive too, and pipelines requests on that one
connection; the answers come back on it. Both are peer frames: the topic is the name of the service, the
type one of three, and the data begins with a fixed header, big-endian::

    simple_ros.ServiceRequest    u64 id | u32 time left in ms, 0 for ever | u8 priority | request
    simple_ros.ServiceResponse   u64 id | u8 status | response, or a simple_ros.ServiceError
    simple_ros.ServiceCancel     u64 id

Ids are the client's own, unique on the connection. Answers come in any order. Time is given as what is
left, since clocks of hosts differ.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from enum import IntEnum
from struct import Struct
from typing import Generic, NamedTuple, TypeVar

from simple_ros.wire.framing import Payload

__all__ = [
    "CANCEL_TYPE",
    "REQUEST_TYPE",
    "RESPONSE_TYPE",
    "AdaptiveTimeout",
    "CallQueue",
    "Deadlines",
    "Request",
    "RttEstimator",
    "Status",
    "pack_cancel",
    "pack_request",
    "pack_response",
    "unpack_cancel",
    "unpack_request",
    "unpack_response",
]

REQUEST_TYPE = "simple_ros.ServiceRequest"
RESPONSE_TYPE = "simple_ros.ServiceResponse"
CANCEL_TYPE = "simple_ros.ServiceCancel"

_REQUEST = Struct(">QIB")
_RESPONSE = Struct(">QB")
_CANCEL = Struct(">Q")
_MAX_MS = 2**32 - 1

Item = TypeVar("Item")


class Status(IntEnum):
    """How a call ended."""

    OK = 0
    RAISED = 1
    UNKNOWN_SERVICE = 2
    MALFORMED = 3
    EXPIRED = 4
    OVERLOADED = 5


class Request(NamedTuple):
    """A request as it arrives.

    Attributes:
        id: The client's number for it.
        timeout_s: Time left when it was sent, or None.
        priority: 0 to 255; higher goes first.
        payload: The serialised request.
    """

    id: int
    timeout_s: float | None
    priority: int
    payload: Payload


def pack_request(number: int, timeout_s: float | None, priority: int, payload: bytes) -> bytes:
    """The data of a request frame."""
    left_ms = 0 if timeout_s is None else min(max(1, round(timeout_s * 1000)), _MAX_MS)
    return _REQUEST.pack(number, left_ms, priority) + payload


def unpack_request(data: Payload) -> Request:
    """Read the data of a request frame.

    Raises:
        ValueError: It is too short.
    """
    if len(data) < _REQUEST.size:
        raise ValueError(f"a service request of {len(data)} bytes")
    number, left_ms, priority = _REQUEST.unpack_from(data)
    return Request(number, left_ms / 1000 if left_ms else None, priority, data[_REQUEST.size :])


def pack_response(number: int, status: int, payload: bytes) -> bytes:
    """The data of a response frame."""
    return _RESPONSE.pack(number, status) + payload


def unpack_response(data: Payload) -> tuple[int, int, Payload]:
    """Read the data of a response frame: id, status, payload.

    Raises:
        ValueError: It is too short.
    """
    if len(data) < _RESPONSE.size:
        raise ValueError(f"a service response of {len(data)} bytes")
    number, status = _RESPONSE.unpack_from(data)
    return number, status, data[_RESPONSE.size :]


def pack_cancel(number: int) -> bytes:
    """The data of a frame that takes a request back."""
    return _CANCEL.pack(number)


def unpack_cancel(data: Payload) -> int:
    """Read the data of a cancel frame.

    Raises:
        ValueError: It has the wrong size.
    """
    if len(data) != _CANCEL.size:
        raise ValueError(f"a service cancel of {len(data)} bytes")
    return int(_CANCEL.unpack(data)[0])


@dataclass(frozen=True, slots=True)
class AdaptiveTimeout:
    """A timeout that follows the round trips measured so far, as TCP's does (RFC 6298).

    ``factor`` times (smoothed round trip + 4 times its mean deviation), between ``min_s`` and ``max_s``;
    twice as long after each call that timed out, until one is answered.

    Attributes:
        min_s: Never shorter, in seconds.
        max_s: Never longer.
        initial_s: Before the first answer.
        factor: How much longer than TCP would wait: a handler works, too.
    """

    min_s: float = 0.2
    max_s: float = 30.0
    initial_s: float = 3.0
    factor: float = 2.0

    def __post_init__(self) -> None:
        """Check that it makes sense."""
        if not 0 < self.min_s <= self.initial_s <= self.max_s or self.factor < 1:
            raise ValueError(f"{self} needs 0 < min_s <= initial_s <= max_s and factor >= 1")


class RttEstimator:
    """Smoothed round-trip time and its deviation (RFC 6298, sections 2 and 5.5)."""

    _ALPHA = 1 / 8
    _BETA = 1 / 4
    _MOST_BACKOFF = 64

    def __init__(self) -> None:
        self.srtt_s: float | None = None
        self.rttvar_s = 0.0
        self._backoff = 1

    def measured(self, rtt_s: float) -> None:
        """A call was answered after so many seconds."""
        self._backoff = 1
        if self.srtt_s is None:
            self.srtt_s, self.rttvar_s = rtt_s, rtt_s / 2
            return
        self.rttvar_s += self._BETA * (abs(self.srtt_s - rtt_s) - self.rttvar_s)
        self.srtt_s += self._ALPHA * (rtt_s - self.srtt_s)

    def timed_out(self) -> None:
        """A call was not answered in time."""
        self._backoff = min(self._backoff * 2, self._MOST_BACKOFF)

    def timeout_s(self, policy: AdaptiveTimeout) -> float:
        """How long to wait for the next answer."""
        if self.srtt_s is None:
            wait = policy.initial_s
        else:
            wait = max(policy.factor * (self.srtt_s + 4 * self.rttvar_s), policy.min_s)
        return min(wait * self._backoff, policy.max_s)


class Deadlines:
    """When which call is overdue; removing one costs nothing."""

    def __init__(self) -> None:
        self._heap: list[tuple[float, int]] = []
        self._due: dict[int, float] = {}

    def add(self, number: int, due: float) -> None:
        """A call is due at a time."""
        self._due[number] = due
        heapq.heappush(self._heap, (due, number))

    def remove(self, number: int) -> None:
        """A call has ended."""
        self._due.pop(number, None)
        if len(self._heap) > 2 * len(self._due) + 64:
            self._heap = [(due, number) for number, due in self._due.items()]
            heapq.heapify(self._heap)

    @property
    def next_due(self) -> float | None:
        """When the next call is due, or None."""
        while self._heap:
            due, number = self._heap[0]
            if self._due.get(number) == due:
                return due
            heapq.heappop(self._heap)
        return None

    def overdue(self, now: float) -> list[int]:
        """Calls that are due, in order; they are removed."""
        found = []
        while (due := self.next_due) is not None and due <= now:
            _, number = heapq.heappop(self._heap)
            del self._due[number]
            found.append(number)
        return found


class CallQueue(Generic[Item]):
    """Requests that wait for their turn: the highest priority first, then in order.

    Args:
        limit: How many may wait.
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._heap: list[tuple[int, int, Item]] = []
        self._count = 0

    def __len__(self) -> int:
        return len(self._heap)

    def push(self, item: Item, priority: int) -> bool:
        """Take a request; False if too many wait already."""
        if len(self._heap) >= self._limit:
            return False
        self._count += 1
        heapq.heappush(self._heap, (-priority, self._count, item))
        return True

    def pop(self) -> Item:
        """The next request. Only called when there is one."""
        return heapq.heappop(self._heap)[2]
