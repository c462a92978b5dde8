"""One session: what each submessage of the board means, and what is written to its readers."""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable, Hashable

from simple_ros.errors import MessageTooLarge
from simple_ros_firmware_bridge.xrce import wire
from simple_ros_firmware_bridge.xrce.creation import ObjectId, Reader, parse_creation
from simple_ros_firmware_bridge.xrce.downlink import best_effort_limit
from simple_ros_firmware_bridge.xrce.events import (
    Endpoint,
    EndpointGone,
    EndpointRefused,
    Event,
    ReaderReady,
    Sample,
    ServiceCalled,
    ServiceOffered,
    ServiceReplied,
    ServiceWanted,
    WriterReady,
)
from simple_ros_firmware_bridge.xrce.objects import Identity, Objects, ReadRequest
from simple_ros_firmware_bridge.xrce.streams import SessionStreams
from simple_ros_firmware_bridge.xrce.wire import (
    Header,
    Kind,
    MalformedMessage,
    Status,
    Submessage,
    SubmessageId,
)

__all__ = ["Session", "UnknownReader", "UnknownWriter"]

_UNLIMITED = 0xFFFF
_GUID_BYTES = 16
_CREATED_WITHIN_S = 10.0
"""A board that begins anew creates everything within that time; what it does not is of a former program."""


class UnknownReader(LookupError):
    """The board did not ask for samples of that reader."""


class UnknownWriter(MalformedMessage):
    """A board writes with a writer that it never created here: it is not who we take it for."""


def ready_event(endpoint: Endpoint) -> Event:
    """What it means that a board asks for what comes to one of its objects."""
    match endpoint.object_id.kind:
        case Kind.REQUESTER:
            return ServiceWanted(endpoint)
        case Kind.REPLIER:
            return ServiceOffered(endpoint)
        case _:
            return ReaderReady(endpoint)


class Session:
    """Answers a board. After each call take `data_to_send` first, then `events`.

    Args:
        identity: Who it is with.
        objects: What the board created.
        is_resumed: Whether its streams are somewhere in their middle, where is not known.
    """

    def __init__(self, identity: Identity, objects: Objects, *, is_resumed: bool = False) -> None:
        self.identity = identity
        self.objects = objects
        self.streams = SessionStreams(identity, is_resumed=is_resumed)
        self.malformed = 0
        self._is_resumed = is_resumed
        self._former = set[ObjectId]() if is_resumed else set(objects.created)
        self._former_until: float | None = None
        self._has_created = False
        self._events: deque[Event] = deque()
        self._handlers: dict[int, Callable[[int, Submessage, float], None]] = {
            SubmessageId.CREATE: self._create,
            SubmessageId.DELETE: self._delete,
            SubmessageId.WRITE_DATA: lambda stream, item, _: self._write_data(stream, item),
            SubmessageId.READ_DATA: self._read_data,
            SubmessageId.ACKNACK: lambda _, item, now: self.streams.acknack(item, now),
            SubmessageId.HEARTBEAT: lambda _, item, now: self._heartbeat(item, now),
            SubmessageId.RESET: lambda *_: self.streams.reset(),
            SubmessageId.FRAGMENT: self._fragment,
        }

    # -- what comes ----------------------------------------------------------------------------

    def receive(self, header: Header, data: bytes, now: float) -> None:
        """A message of this session.

        Raises:
            UnknownWriter: It is not the board we take it for.
        """
        if self._former:
            self._judge_former(now)
        for body in self.streams.receive(header, data, now):
            self._handle(header.stream, body, now)

    def _judge_former(self, now: float) -> None:
        """Forget what was there before the board began anew, if it creates what it needs and this not."""
        if self._former_until is None:
            self._former_until = now + _CREATED_WITHIN_S
        if now < self._former_until:
            return
        former, self._former = self._former, set()
        if self._has_created:
            for object_id in former:
                self._remove(object_id)

    def _handle(
        self, stream: int, body: bytes, now: float, *, is_put_together: bool = False
    ) -> None:
        try:
            for item in wire.parse_submessages(body, 0):
                if is_put_together and item.id == SubmessageId.FRAGMENT:
                    self.malformed += 1  # fragments in fragments in fragments would have no end
                    return
                handler = self._handlers.get(item.id)
                if handler is not None:
                    handler(stream, item, now)
        except UnknownWriter:
            raise
        except MalformedMessage:
            self.malformed += 1

    def _heartbeat(self, item: Submessage, now: float) -> None:
        stream, ready = self.streams.heartbeat(item, now)
        for body in ready:
            self._handle(stream, body, now)

    def _fragment(self, stream: int, item: Submessage, now: float) -> None:
        whole = self.streams.fragment(stream, item)
        if whole is not None:
            self._handle(stream, whole, now, is_put_together=True)

    def _create(self, stream: int, item: Submessage, now: float) -> None:
        wanted = parse_creation(item.payload, item.order)
        self._former.discard(wanted.object_id)
        self._has_created = True
        before = self.objects.endpoint(wanted.object_id)
        status, reason = self.objects.create(wanted)
        self._status(stream, item.payload[:4], status, now)
        if reason:
            self._events.append(EndpointRefused(reason))
            return
        endpoint = self.objects.endpoint(wanted.object_id)
        if before is not None and before != endpoint:
            self._events.append(EndpointGone(before.object_id))
        if endpoint is not None and wanted.kind == Kind.DATAWRITER and before != endpoint:
            self._events.append(WriterReady(endpoint))

    def _delete(self, stream: int, item: Submessage, now: float) -> None:
        object_id = ObjectId(item.payload[2:4])
        self._former.discard(object_id)
        self._status(stream, item.payload[:4], self._remove(object_id), now)

    def _remove(self, object_id: ObjectId) -> Status:
        status = self.objects.delete(object_id)
        if status == Status.OK and object_id.kind >= Kind.DATAWRITER:
            self.streams.forget(object_id)
            self._events.append(EndpointGone(object_id))
        return status

    def _status(self, stream: int, ids: bytes, status: Status, now: float) -> None:
        body = wire.submessage(SubmessageId.STATUS, ids + bytes((status, 0)))
        self.streams.answer(stream, body, now)

    def _write_data(self, stream: int, item: Submessage) -> None:
        self.streams.whole_came(stream)
        if len(item.payload) < 4 or item.flags & 0x0E:
            raise MalformedMessage("WRITE_DATA that is no single sample")
        writer = ObjectId(item.payload[2:4])
        if self.objects.endpoint(writer) is None:
            problem = f"a sample of writer {writer!r}, which does not exist"
            raise (UnknownWriter if self._is_resumed else MalformedMessage)(problem)
        match self.objects.created[writer].kind:
            case Kind.REQUESTER:
                call = ServiceCalled(writer, item.payload[:4], item.payload[4:], item.order)
                self._events.append(call)
            case Kind.REPLIER:
                fields = Reader(item.payload[4:], item.order)
                fields.raw(_GUID_BYTES + 4)
                number = fields.number("I")
                data = item.payload[4 + fields.position :]
                self._events.append(ServiceReplied(writer, number, data, item.order))
            case _:
                self._events.append(Sample(writer, item.payload[4:], item.order))

    def _read_data(self, stream: int, item: Submessage, now: float) -> None:
        fields = Reader(item.payload, item.order)
        request, reader = fields.raw(2), ObjectId(fields.raw(2))
        wanted_stream = fields.raw(1)[0]
        fields.raw(1)
        fields.optional_text()
        count = fields.number("H") if fields.flag() else 1
        endpoint = self.objects.endpoint(reader)
        if endpoint is None:
            self._status(stream, request + reader, Status.UNKNOWN_REFERENCE, now)
            return
        self.streams.forget(reader)
        if count == 0:
            if self.objects.reads.pop(reader, None) is not None:
                self._events.append(EndpointGone(reader))
            return
        remaining = None if count == _UNLIMITED else count
        is_new = reader not in self.objects.reads
        self.objects.reads[reader] = ReadRequest(request, wanted_stream, remaining)
        if is_new:
            self._events.append(ready_event(endpoint))

    # -- what goes -----------------------------------------------------------------------------

    def reply(self, requester: ObjectId, call: bytes, data: bytes, name: str, now: float) -> None:
        """The reply to a call of the board. Raises as `write`."""
        self.write(requester, call + data, name, now, call)

    def request(self, replier: ObjectId, call: int, data: bytes, name: str, now: float) -> None:
        """A request for a service of the board, as call number ``call``. Raises as `write`."""
        identity = bytes(_GUID_BYTES) + struct.pack("<iI", 0, call)
        self.write(replier, identity + data, name, now, call)

    def write(
        self, reader: ObjectId, data: bytes, topic: str, now: float, call: Hashable = None
    ) -> None:
        """A sample for a reader of the board. An older one that still waits is replaced.

        Args:
            reader: Its id.
            data: Plain CDR, little endian.
            topic: For errors.
            now: The time.
            call: Of a request or reply: those of other calls are not replaced.

        Raises:
            MessageTooLarge: The board cannot take so much.
            UnknownReader: It did not ask for any.
        """
        request = self.objects.reads.get(reader)
        if request is None:
            raise UnknownReader(repr(reader))
        payload = request.request_id + reader + data
        if wire.is_reliable(request.stream):
            self.streams.offer(request.stream, (reader, call), topic, payload, len(data), now)
        else:
            limit = best_effort_limit(self.identity.mtu) - (4 if self.identity.is_keyed else 0)
            if len(data) > limit:
                raise MessageTooLarge(topic, len(data), limit)
            body = wire.submessage(SubmessageId.DATA, payload)
            self.streams.send_best_effort(request.stream, body)
        if request.remaining is not None:
            request.remaining -= 1
            if not request.remaining:
                del self.objects.reads[reader]

    def line_damaged(self, remains: bytes, now: float) -> None:
        """As `SessionStreams.line_damaged` says."""
        self.streams.line_damaged(remains, now)

    def data_to_send(self) -> list[bytes]:
        """Messages for the board, each told once."""
        return self.streams.data_to_send()

    def ready_events(self) -> list[Event]:
        """What the board has: as if it had just created it."""
        writers = self.objects.endpoints(Kind.DATAWRITER)
        asking = [self.objects.endpoint(reader) for reader in self.objects.reads]
        ready: list[Event] = [WriterReady(item) for item in writers]
        return ready + [ready_event(item) for item in asking if item is not None]

    def events(self) -> list[Event]:
        """What happened, each told once."""
        events = list(self._events)
        self._events.clear()
        return events

    def next_timeout(self) -> float | None:
        """When to call `handle_timeout`."""
        return self.streams.next_timeout()

    def handle_timeout(self, now: float) -> None:
        """Send what is due."""
        self.streams.handle_timeout(now)
