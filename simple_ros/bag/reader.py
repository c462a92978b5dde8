"""Reading bags: in the order of time, a chunk at a time, however large they are."""

from __future__ import annotations

import sys
from array import array
from bisect import bisect_left
from collections.abc import Collection, Iterator
from operator import attrgetter
from pathlib import Path
from struct import error as struct_error
from typing import Self, TypeVar

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Attachment, Chunk, ChunkIndex, McapRecord, Metadata
from mcap.summary import Summary

from simple_ros.bag.errors import BagDamaged
from simple_ros.bag.messages import BagMessage, topic_of
from simple_ros.bag.scan import Found, check_magic, is_ended, opened, parsed, walk
from simple_ros.bag.unpacking import Stored, unpacked
from simple_ros.names import canonical

__all__ = ["Bag"]

Record = TypeVar("Record", bound=McapRecord)
_INDEX_HEAD_BYTES = 6
_NEVER = 2**64
_by_time = attrgetter("log_time")


class Bag:
    """A bag file that is complete, for reading. Use it as ``with Bag(path) as bag:``.

    Args:
        path: The file.

    Raises:
        NotABag: It is no MCAP file.
        BagDamaged: It was never ended, or its end cannot be read.
        BagUnavailable: It cannot be opened.

    Attributes:
        path: The file.
        size_bytes: Its size.
        topics: The channels by their id.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self._file = opened(self.path)
        try:
            self._open()
        except BaseException:
            self._file.close()
            raise

    def _open(self) -> None:
        check_magic(self.path, self._file)
        ended = is_ended(self._file)
        self.size_bytes = self._file.tell()
        if not ended:
            reason = "the file ends here, with no end of its own (is it still being recorded?)"
            raise BagDamaged(self.path, self.size_bytes, reason)
        self._file.seek(0)
        self._reader = SeekingReader(self._file)
        self._summary = self._checked_summary()
        self.topics = {
            channel.id: topic_of(channel, self._summary.schemas.get(channel.schema_id))
            for channel in self._summary.channels.values()
        }

    def _checked_summary(self) -> Summary:
        try:
            summary = self._reader.get_summary()
        except (McapError, ValueError, MemoryError, struct_error) as error:
            reason = f"the end cannot be read ({error or type(error).__name__})"
            raise BagDamaged(self.path, self.size_bytes, reason) from None
        if summary is None or summary.statistics is None or not _is_indexed(summary):
            raise BagDamaged(self.path, self.size_bytes, "the file has no index")
        return summary

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    # -- what is in it -------------------------------------------------------------------------

    @property
    def message_counts(self) -> dict[int, int]:
        """Messages by channel id."""
        assert self._summary.statistics is not None
        return dict(self._summary.statistics.channel_message_counts)

    @property
    def message_count(self) -> int:
        """All messages."""
        return sum(self.message_counts.values())

    @property
    def start_ns(self) -> int:
        """Earliest log time; 0 if there are no messages."""
        return min((chunk.message_start_time for chunk in self.chunks), default=0)

    @property
    def end_ns(self) -> int:
        """Latest log time; 0 if there are no messages."""
        return max((chunk.message_end_time for chunk in self.chunks), default=0)

    @property
    def chunks(self) -> list[ChunkIndex]:
        """Where the chunks are, by their earliest message."""
        return sorted(
            self._summary.chunk_indexes,
            key=lambda chunk: (chunk.message_start_time, chunk.chunk_start_offset),
        )

    def metadata(self) -> dict[str, dict[str, str]]:
        """What is said about the recording, by name; the last of equal names counts."""
        found = {}
        for entry in self._summary.metadata_indexes:
            record = self._record_at(entry.offset, Metadata)
            found[record.name] = dict(record.metadata)
        return found

    @property
    def attachment_names(self) -> list[str]:
        """Names of the files that travel in it."""
        return [entry.name for entry in self._summary.attachment_indexes]

    def attachments(self) -> Iterator[Attachment]:
        """The files that travel in it, one after another."""
        for entry in self._summary.attachment_indexes:
            yield self._record_at(entry.offset, Attachment)

    def times(self, chunk: ChunkIndex) -> Iterator[tuple[int, array[int]]]:
        """Channel ids and the log times of their messages in a chunk, which is not decompressed."""
        for channel_id, offset in chunk.message_index_offsets.items():
            found = self._found_at(offset, Opcode.MESSAGE_INDEX)
            if (len(found.body) - _INDEX_HEAD_BYTES) % 16:
                raise BagDamaged(self.path, offset, "an index breaks off")
            pairs = array("Q", found.body[_INDEX_HEAD_BYTES:])
            if sys.byteorder == "big":
                pairs.byteswap()
            yield channel_id, pairs[::2]

    # -- messages ------------------------------------------------------------------------------

    def messages(
        self,
        topics: Collection[str] | None = None,
        *,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[BagMessage]:
        """The messages in the order of their log times; equal times in the order of the file.

        Args:
            topics: Only these; None for all.
            start_ns: Only messages of this time and later.
            end_ns: Only messages before this time.

        Raises:
            BagDamaged: A chunk cannot be read.
        """
        wanted = self._channels_of(topics)
        begin = 0 if start_ns is None else start_ns
        end = _NEVER if end_ns is None else end_ns
        chunks = [chunk for chunk in self.chunks if _may_hold(chunk, wanted, begin, end)]
        waiting: list[Stored] = []
        for index, chunk in enumerate(chunks):
            waiting += (
                message
                for message in self._content(chunk)
                if message.channel_id in wanted and begin <= message.log_time < end
            )
            waiting.sort(key=_by_time)
            ready = len(waiting)
            if index + 1 < len(chunks):
                following = chunks[index + 1]
                ready = bisect_left(waiting, following.message_start_time, key=_by_time)
            for message in waiting[:ready]:
                yield self._message(message)
            del waiting[:ready]

    def last_before(
        self, topics: Collection[str], stamp_ns: int, most: int = 1
    ) -> list[BagMessage]:
        """The last messages of each topic before a time that differ, oldest first.

        Args:
            topics: Which topics.
            stamp_ns: Only messages before this time.
            most: How many of each topic at most; looked for among the last ``4 * most``.

        Raises:
            BagDamaged: A chunk cannot be read.
        """
        found = {channel: _Latest(most) for channel in self._channels_of(topics)}
        chunks = [chunk for chunk in self.chunks if chunk.message_start_time < stamp_ns]
        for chunk in sorted(chunks, key=lambda chunk: chunk.message_end_time, reverse=True):
            missing = frozenset(channel for channel, last in found.items() if not last.is_full)
            if not _may_hold(chunk, missing, 0, stamp_ns):
                continue
            in_time = sorted(self._content(chunk), key=_by_time)
            for message in reversed(in_time):
                if message.channel_id in missing and message.log_time < stamp_ns:
                    found[message.channel_id].take(message)
        kept = (message for last in found.values() for message in reversed(last.messages))
        return [self._message(message) for message in sorted(kept, key=_by_time)]

    def _channels_of(self, topics: Collection[str] | None) -> frozenset[int]:
        names = None if topics is None else frozenset(map(canonical, topics))
        return frozenset(
            channel_id
            for channel_id, topic in self.topics.items()
            if names is None or topic.name in names
        )

    def _message(self, stored: Stored) -> BagMessage:
        topic = self.topics[stored.channel_id]
        return BagMessage(topic, stored.log_time, stored.data, stored.publish_time, stored.sequence)

    def _content(self, entry: ChunkIndex) -> list[Stored]:
        chunk = self._record_at(entry.chunk_start_offset, Chunk)
        try:
            return unpacked(chunk).messages
        except ValueError as error:
            raise BagDamaged(self.path, entry.chunk_start_offset, str(error)) from None

    def _record_at(self, offset: int, kind: type[Record]) -> Record:
        record = parsed(self.path, next(walk(self.path, self._file, offset)))
        if not isinstance(record, kind):
            raise BagDamaged(self.path, offset, f"no {kind.__name__} stands here, as the end says")
        return record

    def _found_at(self, offset: int, opcode: int) -> Found:
        found = next(walk(self.path, self._file, offset))
        if found.opcode != opcode:
            raise BagDamaged(self.path, offset, "no index stands here, as the end says")
        return found


class _Latest:
    """The last messages of a channel that differ, taken from the end backwards."""

    def __init__(self, most: int) -> None:
        self.messages: list[Stored] = []
        self._most = most
        self._looked_at = 0

    @property
    def is_full(self) -> bool:
        return len(self.messages) >= self._most or self._looked_at >= 4 * self._most

    def take(self, message: Stored) -> None:
        if not self.is_full:
            self._looked_at += 1
            if all(known.data != message.data for known in self.messages):
                self.messages.append(message)


def _is_indexed(summary: Summary) -> bool:
    assert summary.statistics is not None
    if not summary.statistics.message_count:
        return True
    if not summary.channels or not summary.chunk_indexes:
        return False
    return len(summary.chunk_indexes) == summary.statistics.chunk_count


def _may_hold(chunk: ChunkIndex, channels: frozenset[int], begin: int, end: int) -> bool:
    if chunk.message_end_time < begin or chunk.message_start_time >= end:
        return False
    indexes = chunk.message_index_offsets
    return not indexes or not channels.isdisjoint(indexes)
