"""The XRCE client of a simulated board: connects, creates, publishes and blocks as micro-ROS does."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import Enum

from simple_ros_firmware_bridge.simulator.creation import Topic, creations
from simple_ros_firmware_bridge.simulator.streams import BoardInput, BoardOutput

__all__ = ["BoardClient", "Stage"]

_SESSION = 0x81
_RETRY_S = 1.0
_FIRST_PINGS_S = 0.2
_PUBLISH_LIMIT_S = 1.0
_MOST_PINGS_LOST = 3
_MTU = 508
_PIECE = 500


class Stage(Enum):
    """How far it got."""

    PINGING = "pinging"
    CONNECTING = "connecting"
    CREATING = "creating"
    RUNNING = "running"


@dataclass
class ClientCounters:
    """What happened.

    Attributes:
        published: Samples that were acknowledged, or sent best effort.
        failed: Samples that were not acknowledged within a second.
        resets: How often it began from the start.
    """

    published: int = 0
    failed: int = 0
    resets: int = 0


class BoardClient:
    """One board. Times are seconds of any monotonic clock.

    Args:
        topics: What it publishes and subscribes.
        key: Client key, 4 bytes.
        gives_up: Whether it pings while it runs and begins anew when the agent knows nothing of it, as
            firmware with reconnection logic does; other firmware just goes on.
    """

    def __init__(
        self, topics: list[Topic], key: bytes = b"\x01\x02\x03\x04", *, gives_up: bool = False
    ) -> None:
        self.topics = topics
        self.stage = Stage.PINGING
        self.counters = ClientCounters()
        self.offset_ns: int | None = None
        self.output = BoardOutput()
        self._input = BoardInput()
        self._key = key
        self._gives_up = gives_up
        self._best_effort = 0
        self._creations: list[bytes] = []
        self._request = 0
        self._retry_at: float | None = 0.0
        self._blocked_since: float | None = None
        self._pieces = bytearray()
        self._samples: list[tuple[int, bytes]] = []
        self._out: list[bytes] = []
        self._ping_at: float | None = None
        self._pings_lost = 0

    # -- the application's side ----------------------------------------------------------------

    @property
    def is_blocked(self) -> bool:
        """Whether the program stands in ``rcl_publish``."""
        return self._blocked_since is not None

    def publish(self, index: int, cdr: bytes, now: float) -> bool:
        """Publish on a topic; False if the program is elsewhere (not connected, or blocked)."""
        topic = self.topics[index]
        if self.stage is not Stage.RUNNING or self.is_blocked:
            return False
        self._request = (self._request + 1) & 0x7FFF
        ids = struct.pack(">H", self._request) + topic.endpoint_id
        whole = b"\x07\x01" + struct.pack("<H", 4 + len(cdr)) + ids + cdr
        if not topic.is_reliable:
            self._put(0x01, self._best_effort, whole)
            self._best_effort = (self._best_effort + 1) & 0xFFFF
            self.counters.published += 1
            return True
        bodies = [whole]
        if len(whole) > _MTU - 4:
            cut = [whole[start : start + _PIECE] for start in range(0, len(whole), _PIECE)]
            bodies = [
                bytes((0x0D, 0x03 if piece is cut[-1] else 0x01))
                + struct.pack("<H", len(piece))
                + piece
                for piece in cut
            ]
        if len(bodies) > self.output.free:
            self.counters.failed += 1
            return False
        for body in bodies:
            self._put(0x80, *self.output.put(body, now))
        self._blocked_since = now
        return True

    def take_samples(self) -> list[tuple[int, bytes]]:
        """Samples that came: index of the topic, plain CDR."""
        samples, self._samples = self._samples, []
        return samples

    # -- the line's side -----------------------------------------------------------------------

    def receive(self, message: bytes, now: float) -> None:
        """A message of the agent."""
        session, stream, number = struct.unpack_from("<BBH", message)
        if session in (0x80, _SESSION) and stream == 0x00:
            self._handle(message[4:], now)
        elif session != _SESSION:
            self._handle(message[8:] if session < 0x80 else message[4:], now)
        elif stream < 0x80:
            self._handle(message[4:], now)
        else:
            for body in self._input.put(number, message[4:]):
                self._handle(body, now)
            self._put(0x00, 0, self._input.acknack())
        if self.output.slots:
            self.output.heartbeat_at = now + 0.1

    def _handle(self, body: bytes, now: float) -> None:
        while len(body) >= 4:
            kind, flags, size = struct.unpack_from("<BBH", body)
            payload = body[4 : 4 + size]
            body = body[4 + (size + 3 & ~3) :]
            match kind:
                case 4:
                    self._connected(now)
                case 5 if self.stage is Stage.CREATING:
                    self._status(payload, now)
                case 6:
                    self._pong(payload, now)
                case 9:
                    self._data(payload)
                case 10:
                    self._acknack(payload, now)
                case 11:
                    announced = int.from_bytes(payload[2:4], "little")
                    self._put(0x00, 0, self._input.acknack(announced))
                case 13:
                    self._fragment(payload, now, is_last=bool(flags & 2))
                case 15:
                    seconds, nanoseconds = struct.unpack_from("<iI", payload)
                    self.offset_ns = seconds * 10**9 + nanoseconds - round(now * 1e9)

    def _fragment(self, piece: bytes, now: float, *, is_last: bool) -> None:
        self._pieces += piece
        if is_last:
            whole, self._pieces = bytes(self._pieces), bytearray()
            self._handle(whole, now)

    def _data(self, payload: bytes) -> None:
        for index, topic in enumerate(self.topics):
            if topic.endpoint_id == payload[2:4]:
                self._samples.append((index, payload[4:]))

    def _acknack(self, payload: bytes, now: float) -> None:
        first = int.from_bytes(payload[0:2], "little")
        missing = int.from_bytes(payload[2:4], "big")
        for number, body in self.output.acknack(first, missing, now):
            self._put(0x80, number, body)
        if not self.output.slots and self.is_blocked:
            self._blocked_since = None
            self.counters.published += 1

    # -- from switching on to running ----------------------------------------------------------

    def _connected(self, now: float) -> None:
        if self.stage is not Stage.CONNECTING:
            return
        self.stage = Stage.CREATING
        self.output, self._input = BoardOutput(), BoardInput()
        self._best_effort = 0
        self._pieces = bytearray()
        self._creations = creations(self.topics)
        seconds, rest = divmod(round(now * 1e9), 10**9)
        self._put(0x00, 0, b"\x0e\x01\x08\x00" + struct.pack("<iI", seconds, rest))
        self._create_next(now)

    def _create_next(self, now: float) -> None:
        if not self._creations:
            self.stage, self._retry_at = Stage.RUNNING, None
            self._ping_at = now + _RETRY_S if self._gives_up else None
            return
        self._put(0x80, *self.output.put(self._creations[0], now))
        self._retry_at = now + _RETRY_S

    def _status(self, payload: bytes, now: float) -> None:
        if not self._creations or payload[2:4] != self._creations[0][6:8]:
            return
        if payload[4] > 1:
            self.reset(now)
            return
        # What needs an answer and what needs none: READ_DATA has no STATUS.
        del self._creations[0]
        while self._creations and self._creations[0][0] == 8:
            self._put(0x80, *self.output.put(self._creations.pop(0), now))
        self._create_next(now)

    def _pong(self, payload: bytes, now: float) -> None:
        if self.stage is Stage.PINGING:
            self.stage = Stage.CONNECTING
            self._retry_at = now
            self.handle_timeout(now)
        elif self._ping_at is not None:
            self._pings_lost = 0
            if payload[5] == 0:
                self.reset(now)

    def reset(self, now: float) -> None:
        """Begin anew, as after a reset."""
        self.counters.resets += 1
        self.stage, self._retry_at, self._blocked_since = Stage.PINGING, now, None
        self._ping_at, self._pings_lost = None, 0

    # -- time ----------------------------------------------------------------------------------

    def next_timeout(self) -> float | None:
        """When to call `handle_timeout`."""
        end = None if self._blocked_since is None else self._blocked_since + _PUBLISH_LIMIT_S
        times = (self._retry_at, end, self.output.heartbeat_at, self._ping_at)
        return min((time for time in times if time is not None), default=None)

    def handle_timeout(self, now: float) -> None:
        """Do what is due."""
        heartbeat = self.output.heartbeat(now)
        if heartbeat is not None:
            self._put(0x00, 0, heartbeat)
        if self._blocked_since is not None and now >= self._blocked_since + _PUBLISH_LIMIT_S:
            self._blocked_since = None
            self.counters.failed += 1
        if self._ping_at is not None and now >= self._ping_at:
            self._ping(now)
        if self._retry_at is not None and now >= self._retry_at:
            self._retry(now)

    def _ping(self, now: float) -> None:
        self._pings_lost += 1
        if self._pings_lost > _MOST_PINGS_LOST:
            self.reset(now)
            return
        self._ping_at = now + _RETRY_S
        self._put(0x00, 0, b"\x02\x01\x08\x00\x00\x0a\xff\xfd\x02\x00\x00\x00")

    def _retry(self, now: float) -> None:
        self._retry_at = now + (_FIRST_PINGS_S if self.stage is Stage.PINGING else _RETRY_S)
        match self.stage:
            case Stage.PINGING:
                ask = b"\x02\x01\x08\x00\x00\x0a\xff\xfd\x02\x00\x00\x00"
                self._out.append(b"\x80\x00\x00\x00" + ask)
            case Stage.CONNECTING:
                hello = b"XRCE\x01\x00\x01\x0f" + self._key + bytes((_SESSION, 0))
                hello += struct.pack("<H", _MTU)
                self._out.append(
                    b"\x80\x00\x00\x00\x00\x01" + struct.pack("<H", len(hello)) + hello
                )
            case Stage.CREATING:
                self.reset(now)

    def _put(self, stream: int, number: int, body: bytes) -> None:
        self._out.append(struct.pack("<BBH", _SESSION, stream, number) + body)

    def data_to_send(self) -> list[bytes]:
        """Messages for the agent, each told once."""
        out, self._out = self._out, []
        return out
