"""``simple-ros bag info``, ``list`` and ``get``."""

from __future__ import annotations

import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from simple_ros.cli.bag.arguments import bag_files, counted
from simple_ros.cli.options import JsonOption
from simple_ros.cli.text import columns, json_line, say, size_text
from simple_ros.errors import ConfigError

if TYPE_CHECKING:
    from simple_ros.bag.information import BagInformation, TopicInformation

__all__ = ["get", "info", "information_json", "information_text", "list_topics"]

_SHOWN_GAPS = 5

FilesArgument = Annotated[
    list[Path], typer.Argument(metavar="FILE", help="Bags, or a directory with bags.")
]


def info(files: FilesArgument, json: JsonOption = False) -> None:
    """Print what a bag holds: times, sizes, topics, drops and gaps."""
    from simple_ros.bag.information import inspect

    for index, path in enumerate(bag_files(files)):
        found = inspect(path)
        if json:
            say(json_line(information_json(found)))
        else:
            say(("\n" if index else "") + information_text(found))


def list_topics(files: FilesArgument, json: JsonOption = False) -> None:
    """Print the topics of bags, their types and how many messages they have."""
    from simple_ros.bag import Bag

    counts: dict[tuple[str, str], int] = {}
    for path in bag_files(files):
        with Bag(path) as bag:
            for channel, topic in bag.topics.items():
                key = topic.name, topic.msg_type
                counts[key] = counts.get(key, 0) + bag.message_counts.get(channel, 0)
    rows = sorted(counts.items())
    if json:
        listed = [{"topic": name, "msg": kind, "count": count} for (name, kind), count in rows]
        say(json_line(listed))
    elif rows:
        say(columns([(name, kind, str(count)) for (name, kind), count in rows]))


def get(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The bag.")],
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the attachment.")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help="Where to.", show_default="stdout"),
    ] = None,
) -> None:
    """Take out a file that was attached when the bag was recorded."""
    from simple_ros.bag import Bag

    with Bag(file) as bag:
        data = next((item.data for item in bag.attachments() if item.name == name), None)
        names = ", ".join(map(repr, bag.attachment_names)) or "none"
    if data is None:
        raise ConfigError(f"{file} has no attachment {name!r}; it has {names}")
    if output is None:
        sys.stdout.buffer.write(data)
    else:
        output.write_bytes(data)


def information_text(found: BagInformation) -> str:
    """A bag for people."""
    rows = [
        ("File:", str(found.path)),
        ("Size:", _sizes(found)),
        ("Start:", _date(found.start_ns)),
        ("End:", _date(found.end_ns)),
        ("Duration:", f"{found.duration_s:.3f} s"),
        ("Messages:", f"{found.message_count} in {counted(found.chunks, 'chunk')}"),
    ]
    rows += [("Attached:", name) for name in found.attachments]
    for name, facts in sorted(found.metadata.items()):
        rows += [(f"{name}:", f"{key} = {value}") for key, value in sorted(facts.items())]
    lines = [columns(rows)]
    if found.topics:
        table: list[tuple[str, ...]] = [
            ("TOPIC", "TYPE", "COUNT", "RATE", "FIRST", "LAST", "DROPPED", "GAPS")
        ]
        table += [_topic_row(found, topic) for topic in found.topics]
        lines += ["", columns(table)]
    lines += [line for topic in found.topics for line in _gap_lines(topic)]
    return "\n".join(lines)


def _sizes(found: BagInformation) -> str:
    how = ", ".join(found.compression)
    if found.compression in ((), ("none",)):
        return size_text(found.size_bytes)
    return f"{size_text(found.size_bytes)} ({size_text(found.content_bytes)} before {how})"


def _date(stamp_ns: int) -> str:
    if not stamp_ns:
        return "-"
    seconds, rest = divmod(stamp_ns, 10**9)
    whole = datetime.fromtimestamp(seconds, UTC)
    return f"{whole:%Y-%m-%d %H:%M:%S}.{rest // 10**6:03d} UTC"


def _topic_row(found: BagInformation, topic: TopicInformation) -> tuple[str, ...]:
    def after(stamp_ns: int) -> str:
        return f"{(stamp_ns - found.start_ns) / 1e9:.3f} s" if topic.count else "-"

    return (
        topic.name + (" (latched)" if topic.latched else ""),
        topic.msg_type,
        str(topic.count),
        "-" if topic.rate_hz is None else f"{topic.rate_hz:.2f} Hz",
        after(topic.first_ns),
        after(topic.last_ns),
        str(topic.dropped),
        str(len(topic.gaps)),
    )


def _gap_lines(topic: TopicInformation) -> list[str]:
    lines = [
        f"gap: {topic.name} silent for {gap.duration_s:.3f} s from {gap.start_s:.3f} s on"
        for gap in topic.gaps[:_SHOWN_GAPS]
    ]
    more = len(topic.gaps) - _SHOWN_GAPS
    return [*lines, f"gap: {topic.name} and {more} more"] if more > 0 else lines


def information_json(found: BagInformation) -> dict[str, Any]:
    """A bag as a value for JSON; times in ns since 1970."""
    return {
        "path": str(found.path),
        "size_bytes": found.size_bytes,
        "content_bytes": found.content_bytes,
        "compression": list(found.compression),
        "start_ns": found.start_ns,
        "end_ns": found.end_ns,
        "duration_s": found.duration_s,
        "messages": found.message_count,
        "chunks": found.chunks,
        "attachments": list(found.attachments),
        "metadata": {name: dict(facts) for name, facts in found.metadata.items()},
        "topics": [
            {
                "topic": topic.name,
                "msg": topic.msg_type,
                "count": topic.count,
                "rate_hz": topic.rate_hz,
                "first_ns": topic.first_ns,
                "last_ns": topic.last_ns,
                "dropped": topic.dropped,
                "latched": topic.latched,
                "gaps": [
                    {"start_s": gap.start_s, "duration_s": gap.duration_s} for gap in topic.gaps
                ],
            }
            for topic in found.topics
        ],
    }
