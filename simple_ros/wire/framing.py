"""The peer frame, shared with C++ simple_ros, for data links and for the Master's pushes.

::

    u16be topic_len | topic | u16be type_len | type | u32be data_len | data

``data`` is plain protobuf, possibly empty. There is no magic number and no checksum, so the only
thing that can be *wrong* with a stream is a name longer than `MAX_NAME_BYTES`; that is what HTTP
or noise looks like, and such a stream cannot be followed any further. Everything else
(unknown names, too large or unparsable data) is a well-framed message that its receiver may refuse
while the stream goes on: a C++ publisher never dials twice.

A link usually carries one topic and one type, so the bytes up to ``data_len`` repeat. The decoder
compares them in one step and hands out runs of payloads that share a header. Frames of one size are cut
out by many; larger payloads are never copied. Measured, that is what makes receiving small messages cheap.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache
from struct import Struct
from typing import NamedTuple

from simple_ros.errors import FrameError, MessageTooLarge
from simple_ros.names import MAX_NAME_BYTES

__all__ = [
    "DEFAULT_MAX_MESSAGE_BYTES",
    "EMPTY_UPDATE_TOPIC",
    "LENT_BYTES",
    "MAX_DATA_BYTES",
    "TARGETS_UPDATE_TYPE",
    "FrameDecoder",
    "Payload",
    "Run",
    "encode_frame",
    "encode_header",
    "header_names",
]

DEFAULT_MAX_MESSAGE_BYTES = 256 * 1024 * 1024
"""Payloads above this are drained, not delivered, unless configured otherwise."""
MAX_DATA_BYTES = 2**32 - 1
"""What ``data_len`` can say."""
TARGETS_UPDATE_TYPE = "TopicTargetsUpdate"
"""Type name of a Master's push: bare, although its protobuf package is ``simple_ros``."""
EMPTY_UPDATE_TOPIC = "__master_topic_update"
"""Frame topic of a push whose own topic is empty."""

_U16 = Struct(">H")
_U32 = Struct(">I")
_unpack_u16 = _U16.unpack_from
_unpack_u32 = _U32.unpack_from
_pack_u32 = _U32.pack

_FIRST_BUFFER = 16 * 1024
_SMALL_BUFFER = 256 * 1024
LENT_BYTES = 64 * 1024
"""Payloads of this size on stay valid as long as anybody holds a view of them."""
_RUN_BYTES = 16 * 1024
_CUT_BYTES = 4096
"""Payloads up to this size are cut out by many: parsing copies small ones anyway."""
_CUT_AHEAD = 3
"""If the frame so far on is as long as this one, those between are too, most likely."""
_KEPT_BUFFER = 16 * 1024 * 1024
_MOST_RETIRED = 4


def encode_header(topic: str, msg_type: str) -> bytes:
    """The part of a frame before ``data_len``; the same for all messages of a topic.

    Raises:
        FrameError: A name is longer than `MAX_NAME_BYTES` in UTF-8.
    """
    parts = []
    for name in (topic, msg_type):
        raw = name.encode()
        if len(raw) > MAX_NAME_BYTES:
            raise FrameError(f"name of {len(raw)} bytes is over the limit of {MAX_NAME_BYTES}")
        parts += [_U16.pack(len(raw)), raw]
    return b"".join(parts)


def encode_frame(header: bytes, payload: bytes) -> bytes:
    """A whole frame.

    Args:
        header: From `encode_header`.
        payload: Serialised message.

    Raises:
        MessageTooLarge: The payload does not fit ``data_len``.
    """
    size = len(payload)
    if size > MAX_DATA_BYTES:
        raise MessageTooLarge(str(header_names(header)), size, MAX_DATA_BYTES)
    return header + _pack_u32(size) + payload


def header_names(header: bytes) -> tuple[str, str] | None:
    """Topic and type of a header, or None if they are not UTF-8."""
    (topic_len,) = _unpack_u16(header, 0)
    try:
        return header[2 : 2 + topic_len].decode(), header[4 + topic_len :].decode()
    except UnicodeDecodeError:
        return None


Payload = bytes | memoryview
"""A serialised message as it came."""


class Run(NamedTuple):
    """Consecutive messages with one header.

    Attributes:
        header: As from `encode_header`.
        payloads: Views into the decoder's buffer, valid until its next call; those of `LENT_BYTES` or
            more as long as anybody holds them. Small ones may be bytes.
        oversized: Size in bytes of the one message that is drained instead, else 0.
    """

    header: bytes
    payloads: list[Payload]
    oversized: int = 0


_new_run = tuple.__new__
"""Makes a `Run` without the detour of named tuples."""


class FrameDecoder:
    """Turns a stream of bytes into runs of messages, whatever the chunking.

    A shell either calls `feed` with bytes, or reads into `get_buffer` and calls `received`.
    Memory follows what has arrived, never what a length field announces.

    Attributes:
        error: Why the stream cannot be followed any further; None while it can. Once set, further
            input is ignored.
    """

    def __init__(self, max_message_bytes: int = DEFAULT_MAX_MESSAGE_BYTES) -> None:
        self.error: FrameError | None = None
        self._limit = max_message_bytes
        self._buffer = bytearray(_FIRST_BUFFER)
        self._view = memoryview(self._buffer)
        self._start = 0
        self._end = 0
        self._wanted = 0
        self._peak = 0
        self._drain = 0
        self._header = b""
        self._alone = b""
        self._alone_bytes = -1
        self._lent = False
        self._retired: list[bytearray] = []

    @property
    def header(self) -> bytes:
        """The header of the last message."""
        return self._header

    @property
    def expects_lone(self) -> bool:
        """Whether the next read may well bring one small message, like the last."""
        return self._alone_bytes >= 0 and self._start == self._end

    @property
    def pending_bytes(self) -> int:
        """Bytes of a message that is not complete yet, drained ones not counted."""
        return self._end - self._start

    @property
    def mid_message(self) -> bool:
        """Whether the stream would end inside a message if it ended now."""
        return self._end > self._start or self._drain > 0

    def feed(self, data: bytes | bytearray | memoryview) -> list[Run]:
        """Take bytes of any length; payloads are copied out, so they stay valid."""
        runs: list[Run] = []
        rest = memoryview(data)
        while rest:
            space = self.get_buffer()
            size = min(len(space), len(rest))
            space[:size] = rest[:size]
            rest = rest[size:]
            runs += [
                Run(header, [memoryview(bytes(view)) for view in views], oversized)
                for header, views, oversized in self.received(size)
            ]
        return runs

    def get_buffer(self, sizehint: int = -1) -> memoryview:  # noqa: ARG002
        """Where the next bytes go; never empty. The hint is asyncio's, and of no use here."""
        if self._lent:
            self._take_back()
        if self._start == self._end:
            self._start = self._end = 0
            size = len(self._buffer)
            if size > _KEPT_BUFFER or (size > _SMALL_BUFFER and self._peak <= size // 4):
                self._replace_buffer(_SMALL_BUFFER)
        elif self._end == len(self._buffer):
            self._make_room()
        return self._view[self._end :]

    def received(self, size: int) -> list[Run]:
        """Say that ``size`` bytes were written to `get_buffer`; return what is complete now."""
        return list(self.runs(size))

    def runs(self, size: int) -> Iterable[Run]:
        """As `received`, run by run, each decoded when it is asked for; to be taken to the end.

        A run is short enough that its views are gone before the garbage collector looks at them.
        """
        payload = self.lone(size)
        if payload is not None:
            return (_new_run(Run, (self._header, [payload], 0)),)
        return self._runs(size)

    def lone(self, size: int) -> bytes | None:
        """As `received`, if what came is one small message, as the last time: the usual case where latency counts.

        None if it is anything else, and nothing was taken. The next bytes go where these did.
        """
        start = self._end
        if (
            size == self._alone_bytes
            and self._start == start
            and self._buffer.startswith(self._alone, start)
        ):
            return bytes(self._view[start + len(self._alone) : start + size])
        return None

    def _runs(self, size: int) -> Iterator[Run]:
        if self.error is not None:
            self._start = self._end = 0
            return
        filled = self._end + size == len(self._buffer)
        self._end += size
        while self._start < self._end and self._find_header():
            payloads, oversized = self._read_run(min(self._end, self._start + _RUN_BYTES))
            if not (payloads or oversized):
                payloads, oversized = self._read_run(self._end)
            if payloads:
                yield _new_run(Run, (self._header, payloads, 0))
            if oversized:
                yield Run(self._header, [], oversized)
            if not (payloads or oversized):
                break
        if filled and len(self._buffer) < _SMALL_BUFFER:
            self._replace_buffer(len(self._buffer) * 4)

    def _find_header(self) -> bool:
        """Whether the header of the next message is known; False if more bytes are needed."""
        if self._drain:
            size = min(self._drain, self._end - self._start)
            self._drain -= size
            self._start += size
            if self._drain:
                return False
        known = self._header and self._buffer.startswith(self._header, self._start)
        return bool(known) or self._read_header()

    def _read_run(self, end: int) -> tuple[list[Payload], int]:
        """The messages under the present header that lie before ``end``, and the size of a too large one."""
        header, buffer, view = self._header, self._buffer, self._view
        start, limit, skip = self._start, self._limit, len(self._header)
        payloads: list[Payload] = []
        append = payloads.append
        starts_with = buffer.startswith
        oversized = size = 0
        while True:
            begin = start + skip + 4
            if begin > end:
                size = 0
                break
            (size,) = _unpack_u32(buffer, begin - 4)
            if size > limit:
                oversized = self._drain = size
                start = begin
                break
            stop = begin + size
            if stop > end:
                break
            append(view[begin:stop])
            if size >= LENT_BYTES:
                self._lent = True
            # Messages of one topic are often of one size: one comparison tells.
            prefix = view[start:begin]
            ahead = skip + 4
            start = stop
            if size <= _CUT_BYTES and starts_with(prefix, start + _CUT_AHEAD * (ahead + size)):
                start += _cut_equal(view[start:end], bytes(prefix), size, payloads)
            while starts_with(prefix, start) and (stop := start + ahead + size) <= end:
                append(view[start + ahead : stop])
                start = stop
            if not starts_with(header, start):
                break
        self._expect_one_alone(payloads if not oversized else [], start)
        self._start = start
        self._wanted = skip + 4 + size
        self._peak = max(self._wanted, self._peak - self._peak // 8)
        return payloads, oversized

    def _expect_one_alone(self, payloads: list[Payload], stop: int) -> None:
        """After a small message that came alone and ended at ``stop``, look out for another such."""
        self._alone_bytes = -1
        if len(payloads) == 1 and len(self._buffer) <= _SMALL_BUFFER:
            size = len(payloads[0])
            if size <= _CUT_BYTES:
                self._alone_bytes = stop - self._start
                self._alone = bytes(self._view[self._start : stop - size])

    def _read_header(self) -> bool:
        """Find the header at the read position; False if incomplete or wrong."""
        position = self._start
        for _ in range(2):
            if position + 2 > self._end:
                return False
            (length,) = _unpack_u16(self._buffer, position)
            if length > MAX_NAME_BYTES:
                self.error = FrameError(
                    f"not a simple_ros stream: a name of {length} bytes is announced "
                    f"(at most {MAX_NAME_BYTES})"
                )
                self._start = self._end = 0
                self._alone_bytes = -1
                return False
            position += 2 + length
        if position > self._end:
            return False
        self._header = bytes(self._view[self._start : position])
        return True

    def _make_room(self) -> None:
        """Move what is pending to the front, or into a larger buffer if it can never fit here."""
        size, pending = len(self._buffer), self._end - self._start
        if self._wanted > size:
            # At most twofold what has really come: a length field alone allocates nothing.
            self._replace_buffer(max(min(size * 2, self._wanted), size + _FIRST_BUFFER))
        elif self._start:
            self._view[:pending] = self._view[self._start : self._end]
            self._start, self._end = 0, pending
        else:
            self._replace_buffer(size * 2)

    def _take_back(self) -> None:
        """Large payloads were handed out: who still holds a view of one keeps the buffer with it."""
        self._lent = False
        self._view.release()
        if _is_free(self._buffer):
            self._view = memoryview(self._buffer)
            return
        kept, size = self._buffer, len(self._buffer)
        free = next((item for item in self._retired if len(item) >= size and _is_free(item)), None)
        if free is not None:
            self._retired.remove(free)
        buffer = bytearray(size) if free is None else free
        self._retired = [*self._retired[-_MOST_RETIRED + 1 :], kept]
        pending = self._end - self._start
        buffer[:pending] = memoryview(kept)[self._start : self._end]
        self._buffer, self._view = buffer, memoryview(buffer)
        self._start, self._end = 0, pending

    def _replace_buffer(self, size: int) -> None:
        # Never resize in place: runs handed out may still look into the old buffer.
        pending = self._view[self._start : self._end]
        buffer = bytearray(max(size, len(pending)))
        buffer[: len(pending)] = pending
        self._buffer = buffer
        self._view = memoryview(buffer)
        self._start, self._end = 0, len(pending)


@lru_cache(64)
def _equal_frames(ahead: int, size: int) -> Callable[[memoryview], Iterator[tuple[bytes, bytes]]]:
    return Struct(f"{ahead}s{size}s").iter_unpack


def _cut_equal(frames: memoryview, prefix: bytes, size: int, payloads: list[Payload]) -> int:
    """Take the payloads of the frames that begin with ``prefix``; return how many bytes those frames have."""
    stride, known, append = len(prefix) + size, len(payloads), payloads.append
    whole = frames[: len(frames) // stride * stride]
    for found, payload in _equal_frames(len(prefix), size)(whole):
        if found != prefix:
            break
        append(payload)
    return (len(payloads) - known) * stride


def _is_free(buffer: bytearray) -> bool:
    """Whether nobody holds a view of a buffer, which alone may then change its size."""
    try:
        del buffer[-1:]
    except BufferError:
        return False
    buffer.append(0)
    return True
