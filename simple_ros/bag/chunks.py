"""Making chunks of an MCAP file: messages packed together, compressed, with an index.

The record types are those of the ``mcap`` library. Messages themselves are packed here, many
at a time: a record object for each would take most of the time of a recording.

A message record, all little-endian: opcode (1 byte), length (8), channel id (2), sequence (4),
log time (8), publish time (8), then the message's bytes. https://mcap.dev/spec
"""

from __future__ import annotations

import sys
import zlib
from array import array
from collections.abc import Sequence
from struct import Struct
from typing import Literal, NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Chunk, ChunkIndex, McapRecord

__all__ = ["ChunkBuilder", "Compression", "FinishedChunk", "encoded", "indexed"]

Compression = Literal["zstd", "lz4", "none"]

_MESSAGE = Struct("<BQHIQQ")
_RECORD_HEAD_BYTES = 9
_INDEX_HEAD = Struct("<BQHI")
_OPCODE = int(Opcode.MESSAGE)
_HEAD_BYTES = _MESSAGE.size - _RECORD_HEAD_BYTES
_SEQUENCE_MASK = 0xFFFFFFFF


class FinishedChunk(NamedTuple):
    """A chunk ready to be written.

    Attributes:
        record: The chunk record.
        content_bytes: Size before compression.
        stored_bytes: Size after it.
        compression: As the file names it.
        start: Earliest log time.
        end: Latest log time.
        entries: By channel: times and offsets of its messages, in turn.
    """

    record: bytes
    content_bytes: int
    stored_bytes: int
    compression: str
    start: int
    end: int
    entries: dict[int, array[int]]

    def placed_at(self, offset: int) -> tuple[bytes, ChunkIndex]:
        """The message index records that follow it, and its entry in the end of the file."""
        return indexed(
            self.entries,
            ChunkIndex(
                chunk_start_offset=offset,
                chunk_length=len(self.record),
                compression=self.compression,
                compressed_size=self.stored_bytes,
                uncompressed_size=self.content_bytes,
                message_start_time=self.start,
                message_end_time=self.end,
                message_index_length=0,
                message_index_offsets={},
            ),
        )


def indexed(
    entries_by_channel: dict[int, array[int]], entry: ChunkIndex
) -> tuple[bytes, ChunkIndex]:
    """Message index records for the place right after a chunk; completes the entry."""
    position = entry.chunk_start_offset + entry.chunk_length
    parts = []
    for channel_id, entries in entries_by_channel.items():
        entry.message_index_offsets[channel_id] = position
        body = _little_endian(entries)
        parts.append(_INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, 6 + len(body), channel_id, len(body)))
        parts.append(body)
        position += _INDEX_HEAD.size + len(body)
    records = b"".join(parts)
    entry.message_index_length = len(records)
    return records, entry


def _little_endian(entries: array[int]) -> bytes:
    if sys.byteorder == "big":
        entries = entries[:]
        entries.byteswap()
    return entries.tobytes()


class ChunkBuilder:
    """Gathers messages for one chunk.

    Attributes:
        size_bytes: What has gathered.
        message_count: How many messages that is.
    """

    def __init__(self) -> None:
        self.size_bytes = 0
        self.message_count = 0
        self._parts: list[bytes] = []
        self._index: dict[int, array[int]] = {}
        self._start = 2**64 - 1
        self._end = 0

    def add(
        self,
        channel_id: int,
        log_time: int,
        payloads: Sequence[bytes],
        first_sequence: int,
        publish_time: int,
    ) -> None:
        """Take in messages of one channel and one time."""
        entries = self._index.get(channel_id)
        if entries is None:
            entries = self._index[channel_id] = array("Q")
        position, sequence = self.size_bytes, first_sequence
        append, note, pack = self._parts.append, entries.append, _MESSAGE.pack
        for data in payloads:
            size = len(data) + _HEAD_BYTES
            append(
                pack(
                    _OPCODE,
                    size,
                    channel_id,
                    sequence & _SEQUENCE_MASK,
                    log_time,
                    publish_time,
                )
            )
            append(data)
            note(log_time)
            note(position)
            position += size + _RECORD_HEAD_BYTES
            sequence += 1
        self.size_bytes = position
        self.message_count += len(payloads)
        self._start = min(self._start, log_time)
        self._end = max(self._end, log_time)

    def finished(self, compression: Compression) -> FinishedChunk:
        """The chunk; at least one message was added."""
        content = b"".join(self._parts)
        data = _compressed(content, compression)
        name = "" if compression == "none" else compression
        record = encoded(
            Chunk(
                compression=name,
                data=data,
                message_start_time=self._start,
                message_end_time=self._end,
                uncompressed_crc=zlib.crc32(content),
                uncompressed_size=len(content),
            )
        )
        return FinishedChunk(
            record, len(content), len(data), name, self._start, self._end, self._index
        )


def _compressed(content: bytes, compression: Compression) -> bytes:
    match compression:
        case "zstd":
            return bytes(zstandard.compress(content))
        case "lz4":
            return bytes(lz4.frame.compress(content))
        case "none":
            return content


def encoded(record: McapRecord) -> bytes:
    """A record as bytes."""
    builder = RecordBuilder()
    record.write(builder)
    content: bytes = builder.end()  # type: ignore[no-untyped-call]
    return content
