"""What a bag holds, without decompressing it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from simple_ros.bag.reader import Bag
from simple_ros.bag.series import DROPS

__all__ = ["BagInformation", "Gap", "TopicInformation", "inspect"]

_GAP_PERIODS = 5.0
_LEAST_GAP_S = 0.2
_MOST_GAPS = 1000


@dataclass(frozen=True, slots=True)
class Gap:
    """A topic was silent for much longer than it usually is.

    Attributes:
        start_s: When it began, in seconds after the bag's beginning.
        duration_s: How long it lasted.
    """

    start_s: float
    duration_s: float


@dataclass(frozen=True, slots=True)
class TopicInformation:
    """A topic of a bag.

    Attributes:
        name: Canonical name.
        msg_type: Full protobuf name.
        count: Messages.
        first_ns: Time of the first; 0 if there is none.
        last_ns: Time of the last.
        dropped: Messages that came to the recorder and were not written.
        latched: Whether late joiners were given its last message.
        gaps: Silences of more than five mean periods and 0.2 s; the first thousand.
    """

    name: str
    msg_type: str
    count: int
    first_ns: int
    last_ns: int
    dropped: int
    latched: bool
    gaps: tuple[Gap, ...]

    @property
    def rate_hz(self) -> float | None:
        """Mean rate from the first message to the last; None if there are not two at two times."""
        span_ns = self.last_ns - self.first_ns
        return (self.count - 1) * 1e9 / span_ns if span_ns > 0 else None


@dataclass(frozen=True, slots=True)
class BagInformation:
    """A bag.

    Attributes:
        path: The file.
        size_bytes: Its size.
        content_bytes: Size of its chunks before compression.
        compression: Of its chunks.
        start_ns: Time of the first message, ns since 1970; 0 if there is none.
        end_ns: Time of the last.
        chunks: How many.
        topics: By name.
        attachments: Names of the files that travel along.
        metadata: What is said about the recording.
    """

    path: Path
    size_bytes: int
    content_bytes: int
    compression: tuple[str, ...]
    start_ns: int
    end_ns: int
    chunks: int
    topics: tuple[TopicInformation, ...]
    attachments: tuple[str, ...]
    metadata: Mapping[str, Mapping[str, str]]

    @property
    def duration_s(self) -> float:
        """From the first message to the last, in seconds."""
        return (self.end_ns - self.start_ns) / 1e9

    @property
    def message_count(self) -> int:
        """All messages."""
        return sum(topic.count for topic in self.topics)


class _Silences:
    """Finds the gaps of one channel, given its times piece by piece."""

    def __init__(self, start_ns: int, least_ns: float) -> None:
        self.gaps: list[Gap] = []
        self._start_ns = start_ns
        self._least_ns = least_ns
        self._last: int | None = None

    def take(self, times: list[int]) -> None:
        """Times in order, none before those of earlier pieces."""
        for time in times:
            last = self._last
            if last is not None and time - last > self._least_ns and len(self.gaps) < _MOST_GAPS:
                self.gaps.append(Gap((last - self._start_ns) / 1e9, (time - last) / 1e9))
            self._last = time


def inspect(path: Path) -> BagInformation:
    """Look at a bag; messages are not read, only where they are.

    Raises:
        NotABag: The file is none.
        BagDamaged: It was never ended, or its end cannot be read.
        BagUnavailable: It cannot be opened.
    """
    with Bag(path) as bag:
        chunks = bag.chunks
        metadata = bag.metadata()
        return BagInformation(
            path,
            bag.size_bytes,
            sum(chunk.uncompressed_size for chunk in chunks),
            tuple(sorted({chunk.compression or "none" for chunk in chunks})),
            bag.start_ns,
            bag.end_ns,
            len(chunks),
            _topics(bag, metadata.get(DROPS, {})),
            tuple(bag.attachment_names),
            metadata,
        )


def _topics(bag: Bag, drops: Mapping[str, str]) -> tuple[TopicInformation, ...]:
    spans = _spans(bag)
    silences: dict[int, _Silences] = {}
    counts: Counter[int] = Counter(bag.message_counts)
    for channel, (first, last) in spans.items():
        if counts[channel] > 2:
            period_ns = (last - first) / (counts[channel] - 1)
            silences[channel] = _Silences(
                bag.start_ns, max(_GAP_PERIODS * period_ns, _LEAST_GAP_S * 1e9)
            )
    for chunk in bag.chunks:
        for channel, times in bag.times(chunk):
            if channel in silences:
                silences[channel].take(sorted(times))
    found = []
    for channel, topic in sorted(bag.topics.items(), key=lambda item: item[1].name):
        first, last = spans.get(channel, (0, 0))
        lost = drops.get(topic.name, "0")
        found.append(
            TopicInformation(
                topic.name,
                topic.msg_type,
                counts[channel],
                first,
                last,
                int(lost) if lost.isdigit() else 0,
                topic.is_latched,
                tuple(silences[channel].gaps) if channel in silences else (),
            )
        )
    return tuple(found)


def _spans(bag: Bag) -> dict[int, tuple[int, int]]:
    """By channel: the times of its first and last message."""
    spans: dict[int, tuple[int, int]] = {}
    for chunk in bag.chunks:
        for channel, times in bag.times(chunk):
            if times:
                first, last = spans.get(channel, (times[0], times[0]))
                spans[channel] = min(first, *times), max(last, *times)
    return spans
