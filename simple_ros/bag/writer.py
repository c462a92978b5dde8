"""One bag file being written."""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Self

from mcap.records import Attachment, Channel, Chunk, ChunkIndex, Header, Metadata, Schema

from simple_ros.bag.catalog import MAGIC, Catalog
from simple_ros.bag.chunks import ChunkBuilder, Compression, encoded, indexed
from simple_ros.bag.errors import BagExists, BagUnavailable, DiskFull
from simple_ros.bag.unpacking import ChunkContent

__all__ = ["DEFAULT_CHUNK_BYTES", "BagWriter"]

DEFAULT_CHUNK_BYTES = 4 * 1024 * 1024
_LIBRARY = "simple_ros"
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class BagWriter:
    """Writes an MCAP file; not to be used by several threads at once.

    The file is called ``NAME.active`` until `finish`, which renames it, so that a complete file is told
    from one whose writer was killed. Everything up to the last `flush` survives that.

    Args:
        path: The file's name in the end.
        compression: Of chunks: ``"zstd"``, ``"lz4"`` or ``"none"``.
        chunk_bytes: A chunk is closed when it has grown to this size, in bytes before compression.
        suffix: What is appended to the name meanwhile.

    Raises:
        BagExists: There is such a file, finished or not.
        BagUnavailable: It cannot be made.
        DiskFull: There is no room for as much as its beginning.

    Attributes:
        path: The file's name in the end.
        active_path: Its name now.
        size_bytes: Written so far.
        message_count: Messages added so far.
    """

    def __init__(
        self,
        path: Path,
        compression: Compression = "zstd",
        chunk_bytes: int = DEFAULT_CHUNK_BYTES,
        suffix: str = ".active",
    ) -> None:
        self.path = path
        self.active_path = path.with_name(path.name + suffix)
        self.size_bytes = 0
        self.message_count = 0
        self._compression = compression
        self._chunk_bytes = chunk_bytes
        self._catalog = Catalog()
        self._chunk = ChunkBuilder()
        self._schema_ids: dict[tuple[str, str, bytes], int] = {}
        self._sequences: dict[int, int] = {}
        if path.exists():
            raise BagExists(path)
        try:
            self._file = self.active_path.open("xb", buffering=0)
        except FileExistsError:
            raise BagExists(self.active_path) from None
        except OSError as error:
            raise BagUnavailable(self.active_path, error) from None
        try:
            self._write(MAGIC + encoded(Header(profile="", library=_LIBRARY)))
        except DiskFull:
            self.discard()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.finish()
        else:
            self.discard()

    # -- what is written -----------------------------------------------------------------------

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Define a type; the same definition again is the same id."""
        key = name, encoding, data
        known = self._schema_ids.get(key)
        if known is not None:
            return known
        schema = Schema(id=len(self._schema_ids) + 1, name=name, encoding=encoding, data=data)
        self._define(schema)
        self._schema_ids[key] = schema.id
        return int(schema.id)

    def add_channel(
        self,
        topic: str,
        schema_id: int,
        encoding: str = "protobuf",
        metadata: Mapping[str, str] | None = None,
    ) -> int:
        """Begin a channel: a topic with one type."""
        channel = Channel(
            id=len(self._sequences) + 1,
            topic=topic,
            message_encoding=encoding,
            metadata=dict(metadata or {}),
            schema_id=schema_id,
        )
        self._define(channel)
        self._sequences[channel.id] = 0
        return int(channel.id)

    def _define(self, record: Schema | Channel) -> None:
        self._write(encoded(record))
        self._catalog.define(record)

    def add(
        self,
        channel_id: int,
        log_time: int,
        payloads: Sequence[bytes],
        *,
        publish_time: int | None = None,
        sequence: int | None = None,
    ) -> None:
        """Add messages of one channel that came at one time.

        Args:
            channel_id: As `add_channel` gave it.
            log_time: When they were recorded, in ns since 1970.
            payloads: The messages, serialised.
            publish_time: When they were published, in ns since 1970; None for ``log_time``.
            sequence: Number of the first; None counts up.

        Raises:
            DiskFull: A chunk was complete and found no room; its messages are lost.
        """
        first = self._sequences[channel_id] if sequence is None else sequence
        published = log_time if publish_time is None else publish_time
        self._chunk.add(channel_id, log_time, payloads, first, published)
        self._sequences[channel_id] = first + len(payloads)
        self.message_count += len(payloads)
        if self._chunk.size_bytes >= self._chunk_bytes:
            self._end_chunk()

    def has_channel(self, channel_id: int) -> bool:
        """Whether there is such a channel."""
        return channel_id in self._sequences

    def copy_definition(self, record: Schema | Channel) -> None:
        """Take over a schema or channel of another file, with its id."""
        if isinstance(record, Channel):
            if record.id in self._sequences:
                return
            self._sequences[record.id] = 0
        elif record.id in self._catalog.schemas:
            return
        else:
            self._schema_ids[record.name, record.encoding, record.data] = record.id
        self._define(record)

    def copy_chunk(self, record: bytes, chunk: Chunk, content: ChunkContent) -> None:
        """Take over a chunk of another file as it is; its channels were taken over before."""
        self._end_chunk()
        entries = content.entries()
        records, entry = indexed(
            entries,
            ChunkIndex(
                chunk_start_offset=self.size_bytes,
                chunk_length=len(record),
                compression=chunk.compression,
                compressed_size=len(chunk.data),
                uncompressed_size=chunk.uncompressed_size,
                message_start_time=chunk.message_start_time,
                message_end_time=chunk.message_end_time,
                message_index_length=0,
                message_index_offsets={},
            ),
        )
        self._write(record + records)
        self._catalog.add_chunk(entry, entries)
        self.message_count += len(content.messages)

    def attach(self, name: str, media_type: str, data: bytes, time_ns: int) -> None:
        """Add a file as it is."""
        record = Attachment(
            create_time=time_ns, log_time=time_ns, name=name, media_type=media_type, data=data
        )
        offset, content = self.size_bytes, encoded(record)
        self._write(content)
        self._catalog.add_attachment(record, offset, len(content))

    def note(self, name: str, facts: Mapping[str, str]) -> None:
        """Add facts about the recording."""
        record = Metadata(name=name, metadata=dict(facts))
        offset, content = self.size_bytes, encoded(record)
        self._write(content)
        self._catalog.add_metadata(record, offset, len(content))

    # -- what is safe --------------------------------------------------------------------------

    def flush(self) -> None:
        """Put everything added so far on the disk; what is there survives the end of the power.

        Raises:
            DiskFull: As `add`.
            BagUnavailable: The disk cannot be written.
        """
        self._end_chunk()
        self._sync()

    def _end_chunk(self) -> None:
        if not self._chunk.message_count:
            return
        builder, self._chunk = self._chunk, ChunkBuilder()
        chunk = builder.finished(self._compression)
        index_records, entry = chunk.placed_at(self.size_bytes)
        try:
            self._write(chunk.record + index_records)
        except DiskFull:
            self.message_count -= builder.message_count
            raise
        self._catalog.add_chunk(entry, chunk.entries)

    def _write(self, records: bytes) -> None:
        """Append whole records, or nothing of them."""
        view = memoryview(records)
        try:
            while view:
                view = view[self._file.write(view) :]
        except OSError as error:
            with contextlib.suppress(OSError):
                self._cut(self.size_bytes)
            raise self._failure(error) from None
        self.size_bytes += len(records)

    def _sync(self) -> None:
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            raise self._failure(error) from None

    def _failure(self, error: OSError) -> DiskFull | BagUnavailable:
        if error.errno in _NO_ROOM:
            return DiskFull(self.active_path, error.strerror or str(error))
        return BagUnavailable(self.active_path, error)

    def _cut(self, size_bytes: int) -> None:
        self._file.truncate(size_bytes)
        self._file.seek(size_bytes)
        self.size_bytes = size_bytes

    # -- the end -------------------------------------------------------------------------------

    def finish(self) -> Path:
        """Complete the file and give it its name.

        On a full disk as many of the last chunks are given up as the end of the file needs room.

        Returns:
            The file.

        Raises:
            DiskFull: There is no room for as much as an empty bag; nothing is left of it.
        """
        with contextlib.suppress(DiskFull):
            self._end_chunk()
        while True:
            try:
                self._write(self._catalog.tail(self.size_bytes))
                break
            except DiskFull:
                offset = self._catalog.forget_last_chunk()
                if offset is None:
                    self.discard()
                    raise
                self._cut(offset)
                self.message_count = self._catalog.message_counts.total()
        self._sync()
        self._file.close()
        self._claim_name()
        return self.path

    def _claim_name(self) -> None:
        # A link fails where a rename would replace a file that came meanwhile.
        try:
            os.link(self.active_path, self.path)
        except FileExistsError:
            raise BagExists(self.path) from None
        except OSError:
            self.active_path.rename(self.path)  # a file system without links
        else:
            self.active_path.unlink()
        directory = os.open(self.path.parent, os.O_RDONLY)
        try:
            os.fsync(directory)
        finally:
            os.close(directory)

    def discard(self) -> None:
        """Give the file up."""
        self._file.close()
        self.active_path.unlink(missing_ok=True)
