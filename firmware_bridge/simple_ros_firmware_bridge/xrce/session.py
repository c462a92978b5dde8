"""One session: its streams, its objects, and what each submessage of the board means."""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable, Hashable

from simple_ros.errors import MessageTooLarge
from simple_ros_firmware_bridge.xrce import wire
from simple_ros_firmware_bridge.xrce.creation import ObjectId, Reader, parse_creation
from simple_ros_firmware_bridge.xrce.downlink import Downlink, best_effort_limit
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
from simple_ros_firmware_bridge.xrce.fragments import Reassembly
from simple_ros_firmware_bridge.xrce.input_stream import ReliableInput
from simple_ros_firmware_bridge.xrce.numbers import after, distance
from simple_ros_firmware_bridge.xrce.objects import Identity, Objects, ReadRequest
from simple_ros_firmware_bridge.xrce.output_stream import ReliableOutput
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
_MAX_STREAMS = 8
_GUID_BYTES = 16


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
        self.malformed = 0
        self.old = 0
        self._is_resumed = is_resumed
        self._start = None if is_resumed else 0
        self._inputs: dict[int, ReliableInput] = {}
        self._downlinks: dict[int, Downlink] = {}
        self._reassembly: dict[int, Reassembly] = {}
        self._best_effort_in: dict[int, int] = {}
        self._best_effort_out: dict[int, int] = {}
        self._out: list[bytes] = []
        self._events: deque[Event] = deque()
        self._handlers: dict[int, Callable[[int, Submessage, float], None]] = {
            SubmessageId.CREATE: self._create,
            SubmessageId.DELETE: self._delete,
            SubmessageId.WRITE_DATA: self._write_data,
            SubmessageId.READ_DATA: self._read_data,
            SubmessageId.ACKNACK: self._acknack,
            SubmessageId.HEARTBEAT: self._heartbeat,
            SubmessageId.RESET: self._reset,
            SubmessageId.FRAGMENT: self._fragment,
        }
        if is_resumed:
            self._input(wire.RELIABLE)
            self._downlink(wire.RELIABLE)

    # -- what comes ----------------------------------------------------------------------------

    def receive(self, header: Header, data: bytes, now: float) -> None:
        """A message of this session.

        Raises:
            UnknownWriter: It is not the board we take it for.
        """
        stream = header.stream
        if stream == wire.NO_STREAM:
            self._handle(stream, data[header.size :], now)
        elif not wire.is_reliable(stream):
            self._receive_best_effort(header, data, now)
        else:
            source = self._input(stream)
            ready = source.receive(header.sequence, data[header.size :], now)
            # The board stands still until it has this; decoding can wait.
            self._send(source.answer(now))
            for body in ready:
                self._handle(stream, body, now)

    def _receive_best_effort(self, header: Header, data: bytes, now: float) -> None:
        last = self._best_effort_in.get(header.stream)
        if last is not None and distance(last, header.sequence) <= 0:
            self.old += 1
            return
        if last is not None or len(self._best_effort_in) < _MAX_STREAMS:
            self._best_effort_in[header.stream] = header.sequence
        self._handle(header.stream, data[header.size :], now)

    def _handle(self, stream: int, body: bytes, now: float) -> None:
        try:
            for item in wire.parse_submessages(body, 0):
                handler = self._handlers.get(item.id)
                if handler is not None:
                    handler(stream, item, now)
        except UnknownWriter:
            raise
        except MalformedMessage:
            self.malformed += 1

    def _create(self, stream: int, item: Submessage, now: float) -> None:
        wanted = parse_creation(item.payload, item.order)
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
        status = self.objects.delete(object_id)
        self._status(stream, item.payload[:4], status, now)
        if status == Status.OK and object_id.kind >= Kind.DATAWRITER:
            self._forget_samples(object_id)
            self._events.append(EndpointGone(object_id))

    def _forget_samples(self, reader: ObjectId) -> None:
        for downlink in self._downlinks.values():
            downlink.forget(reader)

    def _write_data(self, stream: int, item: Submessage, now: float) -> None:  # noqa: ARG002
        if stream in self._reassembly:
            self._reassembly[stream].whole_came()
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
        self._forget_samples(reader)
        if count == 0:
            if self.objects.reads.pop(reader, None) is not None:
                self._events.append(EndpointGone(reader))
            return
        remaining = None if count == _UNLIMITED else count
        is_new = reader not in self.objects.reads
        self.objects.reads[reader] = ReadRequest(request, wanted_stream, remaining)
        if is_new:
            self._events.append(ready_event(endpoint))

    def _acknack(self, stream: int, item: Submessage, now: float) -> None:  # noqa: ARG002
        fields = Reader(item.payload, item.order)
        first = fields.number("H")
        missing = int.from_bytes(fields.raw(2), "big")
        downlink = self._downlinks.get(fields.raw(1)[0])
        if downlink is not None:
            again = downlink.output.acknowledged(first, missing, now)
            self._send_numbered(downlink.output.stream, again)
            self._send_due(downlink, now)

    def _heartbeat(self, stream: int, item: Submessage, now: float) -> None:  # noqa: ARG002
        fields = Reader(item.payload, item.order)
        first, last = fields.number("H"), fields.number("H")
        source_stream = fields.raw(1)[0]
        if not wire.is_reliable(source_stream):
            return
        source = self._input(source_stream)
        ready = source.heartbeat(first, now)
        self._send(source.answer(now, last))
        for body in ready:
            self._handle(source_stream, body, now)

    def _reset(self, stream: int, item: Submessage, now: float) -> None:  # noqa: ARG002
        self._inputs.clear()
        self._downlinks.clear()
        self._reassembly.clear()
        self._best_effort_in.clear()
        self._best_effort_out.clear()
        self._start = 0

    def _fragment(self, stream: int, item: Submessage, now: float) -> None:
        if not wire.is_reliable(stream):
            raise MalformedMessage("a fragment on a stream that may lose some")
        reassembly = self._reassembly.get(stream)
        if reassembly is None:
            reassembly = self._reassembly[stream] = Reassembly()
        skipped = self._input(stream).counters.skipped
        whole = reassembly.add(item.payload, skipped, is_last=item.is_last_fragment)
        if whole is not None:
            self._handle(stream, whole, now)

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
            downlink = self._downlink(request.stream)
            downlink.offer((reader, call), topic, payload, len(data))
            self._send_due(downlink, now)
        else:
            limit = best_effort_limit(self.identity.mtu) - (4 if self.identity.is_keyed else 0)
            if len(data) > limit:
                raise MessageTooLarge(topic, len(data), limit)
            self._send_best_effort(request.stream, wire.submessage(SubmessageId.DATA, payload))
        if request.remaining is not None:
            request.remaining -= 1
            if not request.remaining:
                del self.objects.reads[reader]

    def line_damaged(self, remains: bytes, now: float) -> None:
        """Something came that was no longer readable: most likely the message waited for."""
        mine = remains[:1] == bytes((self.identity.session_id,))
        if mine and len(remains) > 1 and not wire.is_reliable(remains[1]):
            return  # an answer or a best-effort sample: nobody waits for it
        for source in self._inputs.values():
            self._send_if(source.ask(now))

    def _status(self, stream: int, ids: bytes, status: Status, now: float) -> None:
        body = wire.submessage(SubmessageId.STATUS, ids + bytes((status, 0)))
        if wire.is_reliable(stream):
            downlink = self._downlink(wire.RELIABLE)
            downlink.answer(body)
            self._send_due(downlink, now)
        else:
            self._send_best_effort(wire.BEST_EFFORT, body)

    def _send_due(self, downlink: Downlink, now: float) -> None:
        self._send_numbered(downlink.output.stream, downlink.due(now))

    def _send_numbered(self, stream: int, messages: list[tuple[int, bytes]]) -> None:
        for sequence, body in messages:
            self._put(stream, sequence, body)

    def _send_best_effort(self, stream: int, body: bytes) -> None:
        sequence = self._best_effort_out.get(stream, 0)
        self._best_effort_out[stream] = after(sequence)
        self._put(stream, sequence, body)

    def _send(self, body: bytes) -> None:
        self._put(wire.NO_STREAM, 0, body)

    def _send_if(self, body: bytes | None) -> None:
        if body is not None:
            self._send(body)

    def _put(self, stream: int, sequence: int, body: bytes) -> None:
        who = self.identity
        self._out.append(wire.message(who.session_id, stream, sequence, who.key, body))

    # -- streams and time ----------------------------------------------------------------------

    def _input(self, stream: int) -> ReliableInput:
        found = self._inputs.get(stream)
        if found is None:
            if len(self._inputs) >= _MAX_STREAMS:
                raise MalformedMessage("too many streams")
            found = self._inputs[stream] = ReliableInput(stream, self._start)
            self._reassembly[stream] = Reassembly(in_middle=self._start is None)
        return found

    def _downlink(self, stream: int) -> Downlink:
        found = self._downlinks.get(stream)
        if found is None:
            who = self.identity
            output = ReliableOutput(stream, self._start)
            found = self._downlinks[stream] = Downlink(output, who.mtu, is_keyed=who.is_keyed)
        return found

    @property
    def inputs(self) -> list[ReliableInput]:
        """Reliable streams from the board."""
        return list(self._inputs.values())

    @property
    def downlinks(self) -> list[Downlink]:
        """Reliable streams to the board."""
        return list(self._downlinks.values())

    def ready_events(self) -> list[Event]:
        """What the board has: as if it had just created it."""
        writers = self.objects.endpoints(Kind.DATAWRITER)
        asking = [self.objects.endpoint(reader) for reader in self.objects.reads]
        ready: list[Event] = [WriterReady(item) for item in writers]
        return ready + [ready_event(item) for item in asking if item is not None]

    def data_to_send(self) -> list[bytes]:
        """Messages for the board, each told once."""
        out, self._out = self._out, []
        return out

    def events(self) -> list[Event]:
        """What happened, each told once."""
        events = list(self._events)
        self._events.clear()
        return events

    def next_timeout(self) -> float | None:
        """When to call `handle_timeout`."""
        times = [item.next_timeout() for item in self._inputs.values()]
        times += [item.output.next_timeout() for item in self._downlinks.values()]
        return min((time for time in times if time is not None), default=None)

    def handle_timeout(self, now: float) -> None:
        """Send what is due."""
        for source in self._inputs.values():
            self._send_if(source.handle_timeout(now))
        for downlink in self._downlinks.values():
            self._send_if(downlink.output.handle_timeout(now))
            self._send_due(downlink, now)
