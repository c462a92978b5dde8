"""The streams of one session: what comes in order, what goes out numbered, what is due."""

from __future__ import annotations

from collections.abc import Hashable

from simple_ros_firmware_bridge.xrce import wire
from simple_ros_firmware_bridge.xrce.creation import Reader
from simple_ros_firmware_bridge.xrce.downlink import Downlink
from simple_ros_firmware_bridge.xrce.fragments import Reassembly
from simple_ros_firmware_bridge.xrce.input_stream import ReliableInput
from simple_ros_firmware_bridge.xrce.numbers import after, distance, is_far_behind
from simple_ros_firmware_bridge.xrce.objects import Identity
from simple_ros_firmware_bridge.xrce.output_stream import ReliableOutput
from simple_ros_firmware_bridge.xrce.wire import Header, MalformedMessage, Submessage

__all__ = ["SessionStreams"]

_MAX_STREAMS = 8


class SessionStreams:
    """Streams are made when they are first used. Times are seconds of any monotonic clock.

    Args:
        identity: Who they are with.
        is_resumed: Whether they are somewhere in their middle, where is not known.
    """

    def __init__(self, identity: Identity, *, is_resumed: bool = False) -> None:
        self.old = 0
        self._identity = identity
        self._start = None if is_resumed else 0
        self._inputs: dict[int, ReliableInput] = {}
        self._downlinks: dict[int, Downlink] = {}
        self._reassembly: dict[int, Reassembly] = {}
        self._best_effort_in: dict[int, int] = {}
        self._best_effort_out: dict[int, int] = {}
        self._out: list[bytes] = []
        if is_resumed:
            self._input(wire.RELIABLE)
            self._downlink(wire.RELIABLE)

    @property
    def inputs(self) -> list[ReliableInput]:
        """Reliable streams from the board."""
        return list(self._inputs.values())

    @property
    def downlinks(self) -> list[Downlink]:
        """Reliable streams to the board."""
        return list(self._downlinks.values())

    # -- what comes ----------------------------------------------------------------------------

    def receive(self, header: Header, data: bytes, now: float) -> list[bytes]:
        """A message; gives the submessages that are to be handled now, in order.

        What a reliable message is answered by is ready to be sent then: the board stands still until it has
        that, and decoding can wait.
        """
        stream, body = header.stream, data[header.size :]
        if stream == wire.NO_STREAM:
            return [body]
        if not wire.is_reliable(stream):
            return [body] if self._is_new(stream, header.sequence) else []
        source = self._input(stream)
        ready = source.receive(header.sequence, body, now)
        answer = source.answer(now)
        self._send(answer)
        if source.is_answered_twice:
            self._send(answer)
        return ready

    def _is_new(self, stream: int, sequence: int) -> bool:
        last = self._best_effort_in.get(stream)
        if last is not None and distance(last, sequence) <= 0 and not is_far_behind(last, sequence):
            self.old += 1
            return False
        if last is not None or len(self._best_effort_in) < _MAX_STREAMS:
            self._best_effort_in[stream] = sequence
        return True

    def heartbeat(self, item: Submessage, now: float) -> tuple[int, list[bytes]]:
        """A HEARTBEAT; gives its stream and what can be handled since the board gave up on the rest."""
        fields = Reader(item.payload, item.order)
        first, last = fields.number("H"), fields.number("H")
        stream = fields.raw(1)[0]
        if not wire.is_reliable(stream):
            return stream, []
        source = self._input(stream)
        ready = source.heartbeat(first, now)
        self._send(source.answer(now, last))
        return stream, ready

    def acknack(self, item: Submessage, now: float) -> None:
        """An ACKNACK: there may be room now, and something to be sent again."""
        fields = Reader(item.payload, item.order)
        first = fields.number("H")
        missing = int.from_bytes(fields.raw(2), "big")
        downlink = self._downlinks.get(fields.raw(1)[0])
        if downlink is not None:
            again = downlink.output.acknowledged(first, missing, now)
            self._send_numbered(downlink.output.stream, again)
            self._send_due(downlink, now)

    def fragment(self, stream: int, item: Submessage) -> bytes | None:
        """A piece of a submessage; gives the whole with the last one.

        Raises:
            MalformedMessage: It came on a stream that may lose some.
        """
        if not wire.is_reliable(stream):
            raise MalformedMessage("a fragment on a stream that may lose some")
        reassembly = self._reassembly.get(stream)
        if reassembly is None:
            reassembly = self._reassembly[stream] = Reassembly()
        skipped = self._input(stream).counters.skipped
        return reassembly.add(item.payload, skipped, is_last=item.is_last_fragment)

    def whole_came(self, stream: int) -> None:
        """A submessage came in one piece."""
        if stream in self._reassembly:
            self._reassembly[stream].whole_came()

    def reset(self) -> None:
        """The board begins every stream anew."""
        self._inputs.clear()
        self._downlinks.clear()
        self._reassembly.clear()
        self._best_effort_in.clear()
        self._best_effort_out.clear()
        self._start = 0

    def line_damaged(self, remains: bytes, now: float) -> None:
        """Something came that was no longer readable: most likely the message waited for."""
        mine = remains[:1] == bytes((self._identity.session_id,))
        if mine and len(remains) > 1 and not wire.is_reliable(remains[1]):
            return  # an answer or a best-effort sample: nobody waits for it
        for source in self._inputs.values():
            self._send_if(source.damaged(now))

    # -- what goes -----------------------------------------------------------------------------

    def answer(self, stream: int, body: bytes, now: float) -> None:
        """An answer to what came on a stream."""
        if wire.is_reliable(stream):
            downlink = self._downlink(wire.RELIABLE)
            downlink.answer(body)
            self._send_due(downlink, now)
        else:
            self.send_best_effort(wire.BEST_EFFORT, body)

    def offer(
        self,
        stream: int,
        source: tuple[Hashable, Hashable],
        topic: str,
        payload: bytes,
        size: int,
        now: float,
    ) -> None:
        """A sample for a reliable stream, as `Downlink.offer` says."""
        downlink = self._downlink(stream)
        downlink.offer(source, topic, payload, size)
        self._send_due(downlink, now)

    def forget(self, reader: Hashable) -> None:
        """Nothing of this reader is to be sent any more."""
        for downlink in self._downlinks.values():
            downlink.forget(reader)

    def send_best_effort(self, stream: int, body: bytes) -> None:
        """One submessage on a stream that may lose it."""
        sequence = self._best_effort_out.get(stream, 0)
        self._best_effort_out[stream] = after(sequence)
        self._put(stream, sequence, body)

    def _send_due(self, downlink: Downlink, now: float) -> None:
        self._send_numbered(downlink.output.stream, downlink.due(now))

    def _send_numbered(self, stream: int, messages: list[tuple[int, bytes]]) -> None:
        for sequence, body in messages:
            self._put(stream, sequence, body)

    def _send(self, body: bytes) -> None:
        self._put(wire.NO_STREAM, 0, body)

    def _send_if(self, body: bytes | None) -> None:
        if body is not None:
            self._send(body)

    def _put(self, stream: int, sequence: int, body: bytes) -> None:
        who = self._identity
        self._out.append(wire.message(who.session_id, stream, sequence, who.key, body))

    def data_to_send(self) -> list[bytes]:
        """Messages for the board, each told once."""
        out, self._out = self._out, []
        return out

    def probe(self) -> None:
        """Ask the board for a sign of life: one that only subscribes has nothing to say by itself."""
        self._send_if(self._downlink(wire.RELIABLE).output.probe())

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
            who = self._identity
            output = ReliableOutput(stream, self._start)
            found = self._downlinks[stream] = Downlink(output, who.mtu, is_keyed=who.is_keyed)
        return found

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
