"""The agent for one board: whatever comes, session or none, there is an answer and never an exception.

Take `data_to_send` after each call before looking at `events`: a board stands still until it has the
answer to what it published.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from simple_ros_firmware_bridge.xrce import memory, wire
from simple_ros_firmware_bridge.xrce.creation import ObjectId, Reader
from simple_ros_firmware_bridge.xrce.events import (
    Event,
    SessionClosed,
    SessionOpened,
    SessionResumed,
)
from simple_ros_firmware_bridge.xrce.objects import Identity, Objects, Profile
from simple_ros_firmware_bridge.xrce.session import Session, UnknownReader, UnknownWriter
from simple_ros_firmware_bridge.xrce.wire import (
    Header,
    MalformedMessage,
    Status,
    Submessage,
    SubmessageId,
)

__all__ = ["Agent", "AgentCounters", "WallClock"]

_COOKIE = b"XRCE"
_VERSION = b"\x01\x00"
_VENDOR = b"\x01\x0f"
_SESSION_OBJECT = b"\xff\xfe"
_AGENT_KIND = 0x0D
_DEFAULT_MTU = 508
_LEAST_MTU = 64
_OUTSIDE = (0x00, 0x80)
"""Session ids of messages that belong to no session."""

WallClock = Callable[[], int]
"""Nanoseconds since 1970: what boards set their clocks by."""


@dataclass
class AgentCounters:
    """What came.

    Attributes:
        messages: Messages of any kind.
        malformed: That made no sense.
        strangers: Of a session that is not known.
        pings: Questions whether we are here.
        sessions: Sessions begun.
    """

    messages: int = 0
    malformed: int = 0
    strangers: int = 0
    pings: int = 0
    sessions: int = 0


class Agent:
    """Speaks to one board. Times are seconds of any monotonic clock.

    Args:
        knows_type: Whether samples of a type, as a board writes it, can be carried.
        wall_clock: For boards that ask the time.
        profiles: What the names of boards that create by REF stand for.
        remembered: What `remembered` gave before a restart.
    """

    def __init__(
        self,
        knows_type: Callable[[str], bool],
        wall_clock: WallClock,
        profiles: Mapping[str, Profile] | None = None,
        remembered: Mapping[str, Any] | None = None,
    ) -> None:
        self.counters = AgentCounters()
        self.session: Session | None = None
        self._knows_type = knows_type
        self._wall_clock = wall_clock
        self._profiles = profiles or {}
        self._out: list[bytes] = []
        self._events: list[Event] = []
        self._unheard = False
        if remembered is not None:
            self._resume(remembered)

    def _resume(self, remembered: Mapping[str, Any]) -> None:
        found = memory.restored(remembered, self._fresh_objects())
        if found is not None:
            identity, objects = found
            self.session = Session(identity, objects, is_resumed=True)
            self._unheard = True

    def remembered(self) -> dict[str, Any] | None:
        """What a restarted agent needs to go on with this board, as JSON; None without a session."""
        return None if self.session is None else memory.saved(self.session)

    # -- what comes ----------------------------------------------------------------------------

    def receive(self, data: bytes, now: float) -> None:
        """A message of the board."""
        self.counters.messages += 1
        try:
            header = wire.parse_header(data)
            if header.session in _OUTSIDE:
                self._receive_outside(header, data)
            else:
                self._receive_inside(header, data, now)
        except UnknownWriter as error:
            # Answering would make the board believe that its samples arrive.
            self._close(f"the board is not the one that was here before: {error.reason}")
        except MalformedMessage:
            self.counters.malformed += 1

    def _receive_outside(self, header: Header, data: bytes) -> None:
        for item in wire.parse_submessages(data, header.size):
            match item.id:
                case SubmessageId.CREATE_CLIENT:
                    self._create_client(item)
                case SubmessageId.GET_INFO:
                    self._info(header, item)
                case SubmessageId.DELETE:
                    self._delete_session(header, item)
                case _:
                    self.counters.malformed += 1

    def _receive_inside(self, header: Header, data: bytes, now: float) -> None:
        answered = header.stream == wire.NO_STREAM and self._answered_anybody(header, data)
        session = self.session
        if session is None or not self._is_of(session, header):
            self.counters.strangers += not answered
            return
        session.receive(header, data, now)
        if self._unheard:
            self._welcome_back(session)

    def _answered_anybody(self, header: Header, data: bytes) -> bool:
        """Questions that need no session of ours, in a message without a stream."""
        answered = False
        for item in wire.parse_submessages(data, header.size):
            match item.id:
                case SubmessageId.GET_INFO:
                    self._info(header, item)
                case SubmessageId.TIMESTAMP:
                    self._timestamp(header, item)
                case SubmessageId.DELETE if item.payload[2:4] == _SESSION_OBJECT:
                    self._delete_session(header, item)
                case _:
                    continue
            answered = True
        return answered

    def _is_of(self, session: Session, header: Header) -> bool:
        who = session.identity
        return header.session == who.session_id and header.key in (b"", who.key)

    def _welcome_back(self, session: Session) -> None:
        self._unheard = False
        self._events.append(SessionResumed(session.identity.key.hex()))
        self._events += session.ready_events()

    def _create_client(self, item: Submessage) -> None:
        fields = Reader(item.payload, item.order)
        cookie, version = fields.raw(4), fields.raw(2)
        fields.raw(2)
        key, session_id = fields.raw(4), fields.raw(1)[0]
        if cookie != _COOKIE:
            raise MalformedMessage("CREATE_CLIENT without the word XRCE")
        if fields.flag():
            for _ in range(2 * min(fields.number("I"), 16)):
                fields.text()
        mtu = fields.number("H") if len(item.payload) >= fields.position + 2 else _DEFAULT_MTU
        if version[:1] != _VERSION[:1] or mtu < _LEAST_MTU:
            self._status_agent(session_id, key, Status.INCOMPATIBLE)
            return
        self._status_agent(session_id, key, Status.OK)
        self._open(Identity(session_id, key, mtu))

    def _open(self, identity: Identity) -> None:
        before = self.session
        is_same = before is not None and before.identity.key == identity.key
        if before is not None and not is_same:
            self._close("another board, or the same one after a reset, connected")
        # Whoever begins anew asks for samples anew; what it created stays and is replaced.
        objects = before.objects if before is not None and is_same else self._fresh_objects()
        self.session = Session(identity, objects)
        self.counters.sessions += 1
        was_unheard, self._unheard = self._unheard, False
        self._events.append(SessionOpened(identity.key.hex(), is_same))
        if was_unheard and is_same:
            self._events += self.session.ready_events()

    def _fresh_objects(self) -> Objects:
        return Objects(self._knows_type, self._profiles)

    def _close(self, reason: str) -> None:
        if self.session is None:
            return
        self._collect(self.session)
        self.session = None
        self._unheard = False
        self._events.append(SessionClosed(reason))

    def _delete_session(self, header: Header, item: Submessage) -> None:
        body = wire.submessage(SubmessageId.STATUS, item.payload[:4] + bytes((Status.OK, 0)))
        self._out.append(wire.message(header.session, wire.NO_STREAM, 0, header.key, body))
        if self.session is not None and self._is_of(self.session, header):
            self._close("the board ended it")

    def _status_agent(self, session_id: int, key: bytes, status: Status) -> None:
        payload = bytes((status, 0)) + _COOKIE + _VERSION + _VENDOR + b"\0"
        body = wire.submessage(SubmessageId.STATUS_AGENT, payload)
        self._out.append(wire.message(session_id, wire.NO_STREAM, 0, key, body))

    def _info(self, header: Header, item: Submessage) -> None:
        """Whether we are here, and whether we know the board: it keeps its session if we do."""
        self.counters.pings += 1
        session = self.session
        is_outside = header.session in _OUTSIDE
        has_session = int(session is not None and (is_outside or self._is_of(session, header)))
        kind = bytes((1, _AGENT_KIND))
        payload = item.payload[:4] + bytes((Status.OK, has_session)) + kind
        payload += _COOKIE + _VERSION + _VENDOR + b"\0" + kind + b"\0" + struct.pack("<hxxI", 1, 0)
        body = wire.submessage(SubmessageId.INFO, payload)
        self._out.append(
            wire.message(header.session, header.stream, header.sequence, header.key, body)
        )

    def _timestamp(self, header: Header, item: Submessage) -> None:
        fields = Reader(item.payload, item.order)
        originate = struct.pack("<iI", fields.number("i"), fields.number("I"))
        seconds, nanoseconds = divmod(self._wall_clock(), 10**9)
        ours = struct.pack("<iI", seconds, nanoseconds)
        body = wire.submessage(SubmessageId.TIMESTAMP_REPLY, ours + ours + originate)
        self._out.append(wire.message(header.session, wire.NO_STREAM, 0, header.key, body))

    # -- what goes -----------------------------------------------------------------------------

    def write(self, reader: ObjectId, data: bytes, topic: str, now: float) -> None:
        """A sample for a reader of the board, as plain CDR, little endian.

        Args:
            reader: Its id, of a `ReaderReady`.
            data: The sample.
            topic: Its topic, for errors.
            now: The time.

        Raises:
            MessageTooLarge: The board cannot take so much.
            UnknownReader: The board does not want any.
        """
        if self.session is None:
            raise UnknownReader(repr(reader))
        self.session.write(reader, data, topic, now)

    def line_damaged(self, remains: bytes, now: float) -> None:
        """Bytes came that were a message once: ask for it at once.

        Args:
            remains: What is left of it, from its first byte.
            now: The time.
        """
        if self.session is not None:
            self.session.line_damaged(remains, now)

    def probe(self) -> None:
        """Ask a silent board for a sign of life."""
        if self.session is not None:
            self.session.streams.probe()

    def give_up(self, reason: str) -> None:
        """The board is not coming back: everything of it is gone."""
        self._close(reason)

    def data_to_send(self) -> list[bytes]:
        """Messages for the board, each told once."""
        if self.session is not None:
            self._out += self.session.data_to_send()
        out, self._out = self._out, []
        return out

    def events(self) -> list[Event]:
        """What happened, each told once."""
        if self.session is not None:
            self._collect(self.session)
        events, self._events = self._events, []
        return events

    def _collect(self, session: Session) -> None:
        self._out += session.data_to_send()
        self._events += session.events()

    def next_timeout(self) -> float | None:
        """When to call `handle_timeout`, None if nothing is waited for."""
        return None if self.session is None else self.session.next_timeout()

    def handle_timeout(self, now: float) -> None:
        """Send what is due."""
        if self.session is not None:
            self.session.handle_timeout(now)
