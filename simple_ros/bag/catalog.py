"""What stands at the end of an MCAP file, kept up to date while the file is written.

The end repeats what a reader needs to find its way without reading the whole file: definitions, where
each chunk is, how many messages there are. Keeping it apart from the writing has two uses beside it:
a file on a full disk is cut back to its last whole record and ended there, and a file that was never
ended is read once and given its end. https://mcap.dev/spec
"""

from __future__ import annotations

import zlib
from array import array
from collections import Counter
from dataclasses import dataclass, field
from struct import pack

from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from simple_ros.bag.chunks import encoded

__all__ = ["MAGIC", "Catalog"]

MAGIC = b"\x89MCAP0\r\n"
_FOOTER_BYTES = 8 + 8 + 4


@dataclass
class _Chunk:
    index: ChunkIndex
    counts: Counter[int]


@dataclass
class Catalog:
    """The definitions of a file and where its parts are."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[_Chunk] = field(default_factory=list)
    attachments: list[AttachmentIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)

    def define(self, record: Schema | Channel) -> None:
        """A definition stands in the file."""
        if isinstance(record, Schema):
            self.schemas[record.id] = record
        else:
            self.channels[record.id] = record

    def add_chunk(self, index: ChunkIndex, entries: dict[int, array[int]]) -> None:
        """A chunk stands in the file, with entries as of `ChunkContent.entries`."""
        counts = Counter({channel: len(pairs) // 2 for channel, pairs in entries.items()})
        self.chunks.append(_Chunk(index, counts))

    def add_attachment(self, record: Attachment, offset: int, length: int) -> None:
        """An attachment stands in the file."""
        self.attachments.append(
            AttachmentIndex(
                offset=offset,
                length=length,
                log_time=record.log_time,
                create_time=record.create_time,
                data_size=len(record.data),
                name=record.name,
                media_type=record.media_type,
            )
        )

    def add_metadata(self, record: Metadata, offset: int, length: int) -> None:
        """A metadata record stands in the file."""
        self.metadata.append(MetadataIndex(offset=offset, length=length, name=record.name))

    def forget_last_chunk(self) -> int | None:
        """Give up the last chunk and what came after it; the offset where it began, if there was one."""
        if not self.chunks:
            return None
        offset: int = self.chunks.pop().index.chunk_start_offset
        self.attachments = [entry for entry in self.attachments if entry.offset < offset]
        self.metadata = [entry for entry in self.metadata if entry.offset < offset]
        return offset

    @property
    def message_counts(self) -> Counter[int]:
        """Messages by channel id."""
        total: Counter[int] = Counter()
        for chunk in self.chunks:
            total.update(chunk.counts)
        return total

    @property
    def start(self) -> int:
        """Earliest log time; 0 if there are no messages."""
        return min((chunk.index.message_start_time for chunk in self.chunks), default=0)

    @property
    def end(self) -> int:
        """Latest log time; 0 if there are no messages."""
        return max((chunk.index.message_end_time for chunk in self.chunks), default=0)

    def _statistics(self) -> Statistics:
        counts = self.message_counts
        return Statistics(
            attachment_count=len(self.attachments),
            channel_count=len(self.channels),
            channel_message_counts=dict(counts),
            chunk_count=len(self.chunks),
            message_count=counts.total(),
            message_start_time=self.start,
            message_end_time=self.end,
            metadata_count=len(self.metadata),
            schema_count=len(self.schemas),
        )

    def tail(self, position: int) -> bytes:
        """Everything after the data section, which ends at ``position``."""
        data_end = encoded(DataEnd(data_section_crc=0))
        start = position + len(data_end)
        groups: list[tuple[Opcode, list[McapRecord]]] = [
            (Opcode.SCHEMA, list(self.schemas.values())),
            (Opcode.CHANNEL, list(self.channels.values())),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, [chunk.index for chunk in self.chunks]),
            (Opcode.ATTACHMENT_INDEX, list(self.attachments)),
            (Opcode.METADATA_INDEX, list(self.metadata)),
        ]
        summary, offsets = b"", b""
        for opcode, records in groups:
            if not records:
                continue
            group = b"".join(map(encoded, records))
            where = SummaryOffset(
                group_opcode=opcode,
                group_start=start + len(summary),
                group_length=len(group),
            )
            offsets += encoded(where)
            summary += group
        offsets_start = start + len(summary)
        summary += offsets
        # The checksum covers the footer up to where it stands itself.
        covered = summary + pack("<BQQQ", Opcode.FOOTER, _FOOTER_BYTES, start, offsets_start)
        footer = Footer(
            summary_start=start,
            summary_offset_start=offsets_start,
            summary_crc=zlib.crc32(covered),
        )
        return data_end + summary + encoded(footer) + MAGIC
