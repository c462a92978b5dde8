"""Reading chunks of an MCAP file: what `chunks` makes.

The limits come first: nothing is allocated by a size that a damaged file claims.
"""

from __future__ import annotations

import zlib
from array import array
from collections.abc import Iterator
from io import BytesIO
from struct import Struct
from typing import NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema

__all__ = ["MAX_CHUNK_BYTES", "ChunkContent", "Stored", "unpacked"]

MAX_CHUNK_BYTES = 1 << 30
"""A chunk that claims to be larger is taken for damage."""

_MESSAGE_HEAD = Struct("<HIQQ")
_RECORD_HEAD = Struct("<BQ")
_OPCODE = int(Opcode.MESSAGE)
_HEAD_BYTES = _MESSAGE_HEAD.size


class Stored(NamedTuple):
    """A message as it stands in a file; times in nanoseconds since 1970-01-01 UTC.

    Attributes:
        log_time: When it was recorded.
        channel_id: The channel of its file.
        data: Its bytes.
        sequence: Its number on its channel.
        publish_time: When it was published, or recorded first.
    """

    log_time: int
    channel_id: int
    data: bytes
    sequence: int
    publish_time: int


class ChunkContent(NamedTuple):
    """What a chunk holds: the messages, where each stands in it, and what else is defined there."""

    messages: list[Stored]
    offsets: list[int]
    definitions: list[Schema | Channel]

    @property
    def span(self) -> tuple[int, int]:
        """Earliest and latest log time; zeros if there are no messages."""
        times = [message.log_time for message in self.messages]
        return (min(times), max(times)) if times else (0, 0)

    def entries(self) -> dict[int, array[int]]:
        """By channel: times and offsets of its messages, in turn."""
        found: dict[int, array[int]] = {}
        for message, offset in zip(self.messages, self.offsets, strict=True):
            entries = found.get(message.channel_id)
            if entries is None:
                entries = found[message.channel_id] = array("Q")
            entries.append(message.log_time)
            entries.append(offset)
        return found


def decompressed(chunk: Chunk) -> bytes:
    """The content of a chunk.

    Raises:
        ValueError: It is damaged, or of an unknown compression.
    """
    size = chunk.uncompressed_size
    if size > MAX_CHUNK_BYTES:
        raise ValueError(f"a chunk claims to hold {size} bytes")
    try:
        match chunk.compression:
            case "":
                content = chunk.data
            case "zstd":
                content = zstandard.ZstdDecompressor().decompress(chunk.data, max_output_size=size)
            case "lz4":
                content = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size)
            case other:
                raise ValueError(f"a chunk has the unknown compression {other!r}")
    except (zstandard.ZstdError, RuntimeError) as error:
        raise ValueError(f"a chunk cannot be decompressed ({error})") from error
    if len(content) != size:
        raise ValueError(f"a chunk holds {len(content)} bytes and claims {size}")
    if chunk.uncompressed_crc and zlib.crc32(content) != chunk.uncompressed_crc:
        raise ValueError("a chunk fails its checksum")
    return bytes(content)


def unpacked(chunk: Chunk) -> ChunkContent:
    """What a chunk holds, in the order it was written.

    Raises:
        ValueError: It is damaged.
    """
    content = decompressed(chunk)
    found = ChunkContent([], [], [])
    messages, offsets = found.messages, found.offsets
    unpack = _MESSAGE_HEAD.unpack_from
    for position, opcode, begin, end in _records(content):
        if opcode == _OPCODE:
            if end - begin < _HEAD_BYTES:
                raise ValueError(f"a message in a chunk has {end - begin} bytes")
            channel_id, sequence, log_time, publish_time = unpack(content, begin)
            data = content[begin + _HEAD_BYTES : end]
            messages.append(Stored(log_time, channel_id, data, sequence, publish_time))
            offsets.append(position)
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            found.definitions.append(_definition(opcode, content[begin:end]))
    return found


def _records(content: bytes) -> Iterator[tuple[int, int, int, int]]:
    """Position, opcode, begin and end of each record."""
    position, total = 0, len(content)
    head, unpack = _RECORD_HEAD.size, _RECORD_HEAD.unpack_from
    while position < total:
        if total - position < head:
            raise ValueError("a record in a chunk breaks off")
        opcode, length = unpack(content, position)
        begin = position + head
        if length > total - begin:
            raise ValueError("a record in a chunk is longer than the chunk")
        yield position, opcode, begin, begin + length
        position = begin + length


def _definition(opcode: int, body: bytes) -> Schema | Channel:
    stream = ReadDataStream(BytesIO(body))
    record: Schema | Channel
    record = Schema.read(stream) if opcode == Opcode.SCHEMA else Channel.read(stream)
    return record
