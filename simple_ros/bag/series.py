"""The files of one recording: one, or one after another when they are split.

Every file stands alone: it defines its types, says how it was made, and begins with the latched
messages that still count, so that a map recorded an hour ago is there from the start.
"""

from __future__ import annotations

import contextlib
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from simple_ros.bag.chunks import Compression
from simple_ros.bag.errors import DiskFull
from simple_ros.bag.plan import LatchedHistory, SplitRule
from simple_ros.bag.writer import DEFAULT_CHUNK_BYTES, BagWriter

__all__ = ["DROPS", "RECORDING", "Attached", "BagSeries", "RecordedTopic", "SeriesOptions"]

RECORDING = "simple_ros.recording"
"""Metadata record about how a file was made."""
DROPS = "simple_ros.drops"
"""Metadata record with the number of messages that were not written, by topic."""
_SMALLEST_CHUNK_BYTES = 64 * 1024


@dataclass(eq=False)
class RecordedTopic:
    """A topic with one type, as it is recorded.

    Attributes:
        topic: Canonical name.
        msg_type: Full protobuf name.
        definition: Serialised ``FileDescriptorSet``; empty if nobody knows it.
        metadata: Of its channel.
        history: What late joiners need, if it is latched.
        received: Messages written or to be written.
        dropped: Messages given up.
    """

    topic: str
    msg_type: str
    definition: bytes
    metadata: Mapping[str, str] = field(default_factory=dict)
    history: LatchedHistory | None = None
    received: int = 0
    dropped: int = 0


@dataclass(frozen=True)
class Attached:
    """A file that travels in the bag."""

    name: str
    media_type: str
    data: bytes


@dataclass(frozen=True)
class SeriesOptions:
    """How the files are written.

    Attributes:
        path: Name of the file, or of all before their numbers are put in.
        compression: Of chunks.
        chunk_bytes: Size of chunks before compression.
        split: When a new file begins.
        max_files: How many files are kept when they are split; None for all.
        min_free_bytes: Recording ends when the disk has less room than this.
        facts: What is said about the recording, in metadata.
        custom: What the user says about it, in metadata.
        attachments: Files that travel along, in each file.
    """

    path: Path
    compression: Compression = "zstd"
    chunk_bytes: int = DEFAULT_CHUNK_BYTES
    split: SplitRule = field(default_factory=SplitRule)
    max_files: int | None = None
    min_free_bytes: int = 0
    facts: Mapping[str, str] = field(default_factory=dict)
    custom: Mapping[str, str] = field(default_factory=dict)
    attachments: Sequence[Attached] = ()


class BagSeries:
    """Writes the files; not to be used by several threads at once.

    Raises:
        BagExists: There is such a file.
        DiskFull: No room for the first file.

    Attributes:
        finished: The files that are complete and kept.
    """

    def __init__(
        self, options: SeriesOptions, on_file: Callable[[Path], None] = lambda _: None
    ) -> None:
        self.finished: list[Path] = []
        self._options = options
        self._on_file = on_file
        self._index = 0
        self._past_bytes = 0
        self._past_messages = 0
        self._repeated = 0
        self._first_ns: int | None = None
        self._topics: list[RecordedTopic] = []
        self._channels: dict[RecordedTopic, int] = {}
        split = options.split.max_bytes
        self._chunk_bytes = options.chunk_bytes
        if split is not None:
            # A file outgrows its limit by no more than a chunk.
            self._chunk_bytes = min(options.chunk_bytes, max(split // 8, _SMALLEST_CHUNK_BYTES))
        self._check_room()
        self._writer = self._opened(0)

    @property
    def size_bytes(self) -> int:
        """Size of all files that were written, those removed since included."""
        return self._past_bytes + self._writer.size_bytes

    @property
    def message_count(self) -> int:
        """Messages in all files that were written; repeated ones are not counted."""
        return self._past_messages + self._writer.message_count - self._repeated

    # -- messages ------------------------------------------------------------------------------

    def add(self, topic: RecordedTopic, log_time: int, payloads: Sequence[bytes]) -> None:
        """Write messages that came at one time, in ns since 1970.

        Raises:
            DiskFull: There is no more room; only `finish` makes sense now.
        """
        size = self._writer.size_bytes
        if self._first_ns is None:
            self._first_ns = log_time
        elif self._options.split.is_due(size, self._first_ns, log_time):
            self._next_file(log_time)
        channel = self._channels.get(topic)
        if channel is None:
            channel = self._channel_of(topic)
        self._writer.add(channel, log_time, payloads)
        if topic.history is not None:
            for payload in payloads:
                topic.history.add(payload, log_time)

    def _channel_of(self, topic: RecordedTopic) -> int:
        encoding = "protobuf" if topic.definition else ""
        writer = self._writer
        schema = writer.add_schema(topic.msg_type, encoding, topic.definition)
        channel = writer.add_channel(topic.topic, schema, "protobuf", topic.metadata)
        self._channels[topic] = channel
        if topic not in self._topics:
            self._topics.append(topic)
        return channel

    def flush(self) -> None:
        """Put everything on the disk.

        Raises:
            DiskFull: There is no more room, or less than is to be left.
        """
        self._writer.flush()
        self._check_room()

    def _check_room(self) -> None:
        least = self._options.min_free_bytes
        if not least:
            return
        free = shutil.disk_usage(self._options.path.parent).free
        if free < least:
            reason = f"{free} bytes are free, --min-free leaves {least}"
            raise DiskFull(self._options.path, reason)

    # -- files ---------------------------------------------------------------------------------

    def _opened(self, index: int) -> BagWriter:
        options = self._options
        path = options.path
        if options.split.is_on:
            path = path.with_name(f"{path.stem}_{index}{path.suffix}")
        writer = BagWriter(path, options.compression, self._chunk_bytes)
        try:
            writer.note(RECORDING, {**options.facts, "split": str(index)})
            if options.custom:
                writer.note("custom", options.custom)
            now = time.time_ns()
            for item in options.attachments:
                writer.attach(item.name, item.media_type, item.data, now)
        except DiskFull:
            writer.discard()
            raise
        self._on_file(path)
        return writer

    def _next_file(self, now_ns: int) -> None:
        # The next is there before the present one is ended: if it cannot be, the present one still can.
        following = self._opened(self._index + 1)
        ended, self._writer = self._writer, following
        self._index += 1
        self._first_ns = now_ns
        self._channels.clear()
        self._past_bytes += ended.size_bytes
        self.finished.append(ended.finish())
        self._past_messages += ended.message_count
        limit = self._options.max_files
        while limit is not None and len(self.finished) >= limit:
            self.finished.pop(0).unlink(missing_ok=True)
        self._repeat_latched(now_ns)

    def _repeat_latched(self, now_ns: int) -> None:
        for topic in self._topics:
            if topic.history is None:
                continue
            channel = self._channel_of(topic)
            for payload, stamp_ns in topic.history.messages():
                self._writer.add(channel, now_ns, [payload], publish_time=stamp_ns)
                self._repeated += 1

    def finish(self, drops: Mapping[str, int]) -> None:
        """Complete the last file, on a full disk with what is written.

        Args:
            drops: Messages that were not written, by topic; said in the file's metadata.

        Raises:
            DiskFull: There is no room for as much as an empty file.
        """
        lost = {topic: str(count) for topic, count in drops.items() if count}
        with contextlib.suppress(DiskFull):
            self._writer.flush()
            if lost:
                self._writer.note(DROPS, lost)
        self.finished.append(self._writer.finish())
