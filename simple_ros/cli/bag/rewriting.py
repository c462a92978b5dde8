"""``simple-ros bag filter``, ``convert`` and ``merge``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from simple_ros.cli.bag.arguments import (
    ChunkSizeOption,
    CompressionName,
    CompressionOption,
    ExcludeOption,
    InArgument,
    OutArgument,
    RegexOption,
    bag_files,
    counted,
    size_of,
)
from simple_ros.cli.text import say

__all__ = ["convert", "filter_messages", "merge"]


def filter_messages(
    source: InArgument,
    target: OutArgument,
    topics: Annotated[
        list[str] | None, typer.Option("-t", "--topic", metavar="TOPIC", help="Only this topic.")
    ] = None,
    regex: RegexOption = None,
    exclude: ExcludeOption = None,
    start: Annotated[
        float, typer.Option("-s", "--start", metavar="S", min=0, help="From so many seconds on.")
    ] = 0.0,
    end: Annotated[
        float | None,
        typer.Option("--end", metavar="S", min=0.001, help="Up to so many seconds."),
    ] = None,
    compression: CompressionOption = CompressionName.ZSTD,
) -> None:
    """Copy a part of a bag: some topics, some of the time."""
    from simple_ros.bag.plan import TopicSelection
    from simple_ros.bag.rewriting import Rewriting, rewrite

    everything = not topics and regex is None
    selection = TopicSelection.made(topics or (), every=everything, pattern=regex, exclude=exclude)
    how = Rewriting(selection.wants, start, end, compression.value)
    count = rewrite([source], target, how)
    if not count:
        asked = "no message of that time and those topics"
        print(f"warning: {source} has {asked}; see 'simple-ros bag list'", file=sys.stderr)
    _tell(target, count)


def convert(
    source: Annotated[
        Path, typer.Argument(metavar="IN", help="A bag, a ROS 1 .bag, or a ROS 2 bag's directory.")
    ],
    target: OutArgument,
    compression: CompressionOption = CompressionName.ZSTD,
    chunk_size: ChunkSizeOption = "4MiB",
) -> None:
    """Copy a bag with another compression, or import one of ROS.

    ROS bags need the extra 'rosbags'. Topics whose type is not shipped with simple_ros are left out.
    """
    if source.suffix == ".mcap" and source.is_file():
        from simple_ros.bag.rewriting import Rewriting, rewrite

        how = Rewriting(compression=compression.value, chunk_bytes=size_of(chunk_size))
        _tell(target, rewrite([source], target, how))
        return
    from simple_ros.bag.ros_import import import_ros_bag

    found = import_ros_bag(source, target, compression.value, size_of(chunk_size))
    for topic, reason in sorted(found.skipped.items()):
        print(f"warning: {topic!r} is left out: {reason}", file=sys.stderr)
    for name, fields in sorted(found.missing.items()):
        print(f"warning: {name} has no place for {', '.join(sorted(fields))}", file=sys.stderr)
    _tell(target, found.messages)


def merge(
    sources: Annotated[list[Path], typer.Argument(metavar="IN", help="Bags, or directories.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="OUT", help="The new bag.")],
    compression: CompressionOption = CompressionName.ZSTD,
) -> None:
    """Join bags in the order of time: the files of one recording, or those of several hosts."""
    from simple_ros.bag.rewriting import Rewriting, rewrite

    how = Rewriting(compression=compression.value)
    _tell(output, rewrite(bag_files(sources), output, how))


def _tell(target: Path, count: int) -> None:
    say(f"wrote {target}: {counted(count)}")
