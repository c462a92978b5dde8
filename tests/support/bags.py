"""Small bags for tests."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from simple_ros.bag import Bag, BagWriter
from simple_ros.bag.chunks import Compression
from simple_ros.msg.definitions import definition_of
from simple_ros.msg.std_msgs import String

START_NS = 1_700_000_000 * 10**9
SECOND = 10**9
DEFINITION = definition_of(String).SerializeToString(deterministic=True)


def text(data: str) -> bytes:
    return String(data=data).SerializeToString()


def make_bag(
    path: Path,
    messages: Iterable[tuple[str, float, str]],
    *,
    compression: Compression = "zstd",
    flush_every: int = 0,
    latched: Iterable[str] = (),
) -> Path:
    """A bag of strings: topic, seconds after the start, text."""
    with BagWriter(path, compression) as writer:
        channels: dict[str, int] = {}
        for count, (topic, after_s, data) in enumerate(messages, 1):
            if topic not in channels:
                schema = writer.add_schema("std_msgs.String", "protobuf", DEFINITION)
                metadata = {"latched": "true"} if topic in latched else {}
                channels[topic] = writer.add_channel(topic, schema, metadata=metadata)
            writer.add(channels[topic], START_NS + round(after_s * SECOND), [text(data)])
            if flush_every and count % flush_every == 0:
                writer.flush()
    return path


def texts(path: Path, *topics: str) -> list[str]:
    """What the messages of a bag say, in order."""
    with Bag(path) as bag:
        return [String.FromString(m.data).data for m in bag.messages(topics or None)]
