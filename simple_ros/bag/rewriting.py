"""Making new bags of old ones: parts of them, several in one, with another compression."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from simple_ros.bag.chunks import Compression
from simple_ros.bag.messages import BagMessage, Topic
from simple_ros.bag.ordering import in_order
from simple_ros.bag.reader import Bag
from simple_ros.bag.series import DROPS
from simple_ros.bag.writer import DEFAULT_CHUNK_BYTES, BagWriter

__all__ = ["Rewriting", "rewrite"]


@dataclass(frozen=True)
class Rewriting:
    """What is taken over, and how it is written.

    Attributes:
        wants: Whether a topic is taken over.
        start_s: From so many seconds after the beginning on.
        end_s: Up to so many seconds after the beginning; None for the end.
        compression: Of chunks.
        chunk_bytes: Size of chunks before compression.
    """

    wants: Callable[[str], bool] = lambda _: True
    start_s: float = 0.0
    end_s: float | None = None
    compression: Compression = "zstd"
    chunk_bytes: int = DEFAULT_CHUNK_BYTES


def rewrite(sources: Sequence[Path], target: Path, how: Rewriting) -> int:
    """Write the messages of all sources to one new file, in the order of their times.

    Attachments and metadata of all sources are taken over.

    Returns:
        How many messages were written.

    Raises:
        NotABag: A source is no bag.
        BagDamaged: A source was never ended, or a part of it cannot be read.
        BagExists: There is a file ``target``.
        DiskFull: There is no room; nothing is left of ``target``.
    """
    bags: list[Bag] = []
    try:
        bags.extend(Bag(source) for source in sources)
        with BagWriter(target, how.compression, how.chunk_bytes, suffix=".part") as writer:
            _take_over(bags, writer)
            _copy(bags, writer, how)
            writer.flush()
        return writer.message_count
    finally:
        for bag in bags:
            bag.close()


def _take_over(bags: Sequence[Bag], writer: BagWriter) -> None:
    attached: set[tuple[str, bytes]] = set()
    facts: dict[str, dict[str, str]] = {}
    drops: Counter[str] = Counter()
    for number, bag in enumerate(bags, 1):
        for item in bag.attachments():
            if (item.name, item.data) not in attached:
                attached.add((item.name, item.data))
                writer.attach(item.name, item.media_type, item.data, item.log_time)
        for name, found in bag.metadata().items():
            if name == DROPS:
                drops.update({topic: int(count) for topic, count in found.items()})
            elif facts.setdefault(name, found) != found:
                facts[f"{name}.{number}"] = found
    for name, found in facts.items():
        writer.note(name, found)
    if drops:
        writer.note(DROPS, {topic: str(count) for topic, count in drops.items()})


def _copy(bags: Sequence[Bag], writer: BagWriter, how: Rewriting) -> None:
    first = min((bag.start_ns for bag in bags if bag.message_count), default=0)
    start = first + round(how.start_s * 1e9)
    end = None if how.end_s is None else first + round(how.end_s * 1e9)

    def read(bag: Bag) -> Iterator[BagMessage]:
        names = {topic.name for topic in bag.topics.values() if how.wants(topic.name)}
        return bag.messages(names, start_ns=start, end_ns=end)

    channels: dict[int, int] = {}
    by_content: dict[object, int] = {}
    for _, message in in_order(bags, read):
        channel = channels.get(id(message.topic))
        if channel is None:
            channel = _channel_of(message.topic, writer, by_content)
            channels[id(message.topic)] = channel
        writer.add(
            channel,
            message.log_time,
            [message.data],
            publish_time=message.publish_time,
            sequence=message.sequence,
        )


def _channel_of(topic: Topic, writer: BagWriter, known: dict[object, int]) -> int:
    """The channel of a topic; equal topics of several bags share one."""
    facts = tuple(sorted(topic.metadata.items()))
    content = (topic.name, topic.msg_type, topic.definition, topic.encoding, facts)
    if content not in known:
        schema = 0
        if topic.msg_type:
            schema = writer.add_schema(topic.msg_type, topic.schema_encoding, topic.definition)
        known[content] = writer.add_channel(topic.name, schema, topic.encoding, topic.metadata)
    return known[content]
