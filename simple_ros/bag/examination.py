"""Is a bag as it should be? Every byte is read."""

from __future__ import annotations

import zlib
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from struct import pack

from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import DecodeError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from simple_ros.bag.errors import BagDamaged
from simple_ros.bag.scan import Found, check_magic, is_ended, opened, parsed, walk
from simple_ros.bag.unpacking import ChunkContent, unpacked
from simple_ros.errors import UnknownMessageType
from simple_ros.msg.definitions import message_class

__all__ = ["Examination", "Finding", "examine"]

_FOOTER_BYTES = 20
_HEADER_OFFSET = 8


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that is not as it should be.

    Attributes:
        offset: Where, in bytes from the beginning of the file.
        reason: What it is.
        is_structural: Whether the file itself is wrong, not only what somebody wrote into it.
    """

    offset: int
    reason: str
    is_structural: bool = True


@dataclass
class Examination:
    """What was found.

    Attributes:
        errors: What makes readers fail or miss something.
        warnings: What is allowed and unusual.
        messages: Messages that are there.
        chunks: Chunks that are there.
    """

    errors: list[Finding] = field(default_factory=list)
    warnings: list[Finding] = field(default_factory=list)
    messages: int = 0
    chunks: int = 0


def examine(path: Path) -> Examination:
    """Read a whole file and compare it with itself.

    Raises:
        NotABag: It does not begin as an MCAP file.
        BagUnavailable: It cannot be opened.
    """
    examiner = _Examiner(path)
    with opened(path) as file:
        check_magic(path, file)
        try:
            for found in walk(path, file):
                examiner.take(found)
        except BagDamaged as damage:
            examiner.error(damage.offset, damage.reason)
        else:
            if not is_ended(file):
                examiner.error(file.tell(), "the file does not end where its footer ends")
    return examiner.result


class _Examiner:
    """Takes record after record."""

    def __init__(self, path: Path) -> None:
        self.result = Examination()
        self._path = path
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._counts: Counter[int] = Counter()
        self._chunks: dict[int, tuple[Chunk, int, dict[int, int]]] = {}
        self._chunk_offset = -1
        self._content: ChunkContent | None = None
        self._parts: dict[int, str] = {}
        self._last_time = 0
        self._said_disorder = False
        self._data_end: int | None = None
        self._summary_start = 0
        self._summary_crc = 0
        self._groups: dict[int, int] = {}

    def error(self, offset: int, reason: str) -> None:
        self.result.errors.append(Finding(offset, reason))

    def warn(self, offset: int, reason: str) -> None:
        self.result.warnings.append(Finding(offset, reason))

    def take(self, found: Found) -> None:
        if self._data_end is not None and found.opcode != Opcode.FOOTER:
            self._groups.setdefault(found.opcode, found.offset)
            self._summary_crc = zlib.crc32(found.raw, self._summary_crc)
        if found.opcode == Opcode.MESSAGE:
            self._message(found)
            return
        try:
            record = parsed(self._path, found)
        except BagDamaged as damage:
            self.error(damage.offset, damage.reason)
            return
        if record is not None:
            self._check(found, record)

    def _check(self, found: Found, record: McapRecord) -> None:
        match record:
            case Header():
                if found.offset != _HEADER_OFFSET:
                    self.error(found.offset, "a header in the middle of the file")
            case Schema() | Channel():
                self._definition(found.offset, record)
            case Chunk():
                self._chunk(found, record)
            case MessageIndex():
                self._message_index(found, record)
            case Attachment() | Metadata():
                self._parts[found.offset] = record.name
            case DataEnd():
                self._data_end = found.offset
                self._summary_start = found.offset + found.length
            case _:
                self._check_end(found, record)

    # -- the data section ----------------------------------------------------------------------

    def _definition(self, offset: int, record: Schema | Channel) -> None:
        known = self._schemas if isinstance(record, Schema) else self._channels
        before = known.get(record.id)
        if before is not None:
            if before != record:
                self.error(offset, f"{_kind(record)} {record.id} is defined twice, differently")
            return
        known[record.id] = record  # type: ignore[assignment]
        if isinstance(record, Schema):
            self._schema(offset, record)
        elif record.schema_id and record.schema_id not in self._schemas:
            self.error(offset, f"channel {record.topic!r} has schema {record.schema_id}, unknown")

    def _schema(self, offset: int, schema: Schema) -> None:
        if schema.id == 0:
            self.error(offset, f"schema {schema.name!r} has the number 0")
        if schema.encoding != "protobuf":
            if schema.encoding == "":
                self.warn(offset, f"the definition of {schema.name!r} was not known")
            return
        try:
            message_class(FileDescriptorSet.FromString(schema.data), schema.name)
        except (DecodeError, UnknownMessageType):
            reason = f"schema {schema.name!r} does not define that type"
            self.result.errors.append(Finding(offset, reason, is_structural=False))

    def _chunk(self, found: Found, chunk: Chunk) -> None:
        self.result.chunks += 1
        self._content = None
        self._chunk_offset = found.offset
        self._chunks[found.offset] = (chunk, found.length, {})
        try:
            content = unpacked(chunk)
        except ValueError as error:
            self.error(found.offset, str(error))
            return
        chunk.data = b""  # kept for its other fields
        self._content = content
        for definition in content.definitions:
            self._definition(found.offset, definition)
        if content.span != (chunk.message_start_time, chunk.message_end_time):
            self.error(found.offset, "a chunk names other times than its messages have")
        for message in content.messages:
            self._count(found.offset, message.channel_id, message.log_time)

    def _message(self, found: Found) -> None:
        channel_id = int.from_bytes(found.body[:2], "little")
        self._count(found.offset, channel_id, int.from_bytes(found.body[6:14], "little"))

    def _count(self, offset: int, channel_id: int, log_time: int) -> None:
        if channel_id not in self._channels and channel_id not in self._counts:
            self.error(offset, f"messages of channel {channel_id}, which was not defined before")
        self._counts[channel_id] += 1
        self.result.messages += 1
        if log_time < self._last_time and not self._said_disorder:
            self._said_disorder = True
            self.warn(offset, "messages are not in the order of their times")
        self._last_time = max(self._last_time, log_time)

    def _message_index(self, found: Found, index: MessageIndex) -> None:
        if self._chunk_offset in self._chunks:
            self._chunks[self._chunk_offset][2][index.channel_id] = found.offset
        if self._content is None:
            return
        content = self._content
        expected = {
            (message.log_time, position)
            for message, position in zip(content.messages, content.offsets, strict=True)
            if message.channel_id == index.channel_id
        }
        if set(index.records) != expected:
            self.error(found.offset, f"the index of channel {index.channel_id} is wrong")

    # -- the end -------------------------------------------------------------------------------

    def _check_end(self, found: Found, record: McapRecord) -> None:
        match record:
            case ChunkIndex():
                self._chunk_index(found.offset, record)
            case AttachmentIndex() | MetadataIndex():
                if self._parts.get(record.offset) != record.name:
                    self.error(found.offset, f"no {record.name!r} stands where the end says")
            case Statistics():
                self._statistics(found.offset, record)
            case SummaryOffset():
                where = self._groups.get(record.group_opcode)
                if record.group_length and where != record.group_start:
                    self.error(found.offset, "the end is not in the order it says")
            case Footer():
                self._footer(found.offset, record)
            case _:
                pass

    def _chunk_index(self, offset: int, entry: ChunkIndex) -> None:
        known = self._chunks.pop(entry.chunk_start_offset, None)
        if known is None:
            self.error(offset, f"no chunk begins at {entry.chunk_start_offset}, as the end says")
            return
        chunk, length, indexes = known
        same = (entry.chunk_length, entry.message_start_time, entry.message_end_time) == (
            length,
            chunk.message_start_time,
            chunk.message_end_time,
        )
        if not same or (entry.message_index_offsets and entry.message_index_offsets != indexes):
            where = entry.chunk_start_offset
            self.error(offset, f"the chunk at {where} is not as the end of the file says")

    def _statistics(self, offset: int, statistics: Statistics) -> None:
        counts = {channel: count for channel, count in self._counts.items() if count}
        told = {
            channel: count for channel, count in statistics.channel_message_counts.items() if count
        }
        total = sum(counts.values())
        if statistics.message_count != total or told != counts:
            self.error(
                offset,
                f"there are {total} messages, the end of the file says {statistics.message_count}",
            )
        if statistics.chunk_count != self.result.chunks:
            self.error(
                offset,
                f"there are {self.result.chunks} chunks, the end of the file says "
                f"{statistics.chunk_count}",
            )

    def _footer(self, offset: int, footer: Footer) -> None:
        if footer.summary_start == 0:
            self.warn(offset, "the file has no index; readers must read all of it")
            return
        if footer.summary_start != self._summary_start:
            self.error(offset, "the end of the file does not begin where it says")
        head = pack(
            "<BQQQ", Opcode.FOOTER, _FOOTER_BYTES, footer.summary_start, footer.summary_offset_start
        )
        if footer.summary_crc and zlib.crc32(head, self._summary_crc) != footer.summary_crc:
            self.error(offset, "the end of the file fails its checksum")
        if self._chunks and Opcode.CHUNK_INDEX in self._groups:
            self.error(offset, f"{len(self._chunks)} chunks are not in the index")


def _kind(record: Schema | Channel) -> str:
    return "schema" if isinstance(record, Schema) else "channel"
