"""``simple-ros bag record``."""

from __future__ import annotations

import asyncio
import getpass
import platform
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from simple_ros.cli.bag.arguments import (
    ChunkSizeOption,
    CompressionName,
    CompressionOption,
    ExcludeOption,
    RegexOption,
    counted,
    pairs_of,
    size_of,
)
from simple_ros.cli.completion import complete_topics
from simple_ros.cli.options import MasterOption
from simple_ros.cli.text import say, size_text
from simple_ros.errors import ConfigError

if TYPE_CHECKING:
    from simple_ros.bag import RecordedTopic, Recorder, RecordingSummary, SeriesOptions
    from simple_ros.bag.plan import TopicSelection
    from simple_ros.node import NodeHandle

__all__ = ["record"]

_MEDIA_TYPES = {
    ".json": "application/json",
    ".urdf": "application/xml",
    ".xml": "application/xml",
    ".yaml": "application/yaml",
    ".yml": "application/yaml",
    ".txt": "text/plain",
}


def record(
    topics: Annotated[
        list[str] | None,
        typer.Argument(metavar="TOPIC", help="These topics.", autocompletion=complete_topics),
    ] = None,
    every: Annotated[bool, typer.Option("-a", "--all", help="All topics.")] = False,
    regex: RegexOption = None,
    exclude: ExcludeOption = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="FILE", help="The file.", show_default="bag_DATE_TIME.mcap"
        ),
    ] = None,
    max_size: Annotated[
        str | None,
        typer.Option("-b", "--max-bag-size", metavar="SIZE", help="Then begin a new file."),
    ] = None,
    max_duration: Annotated[
        float | None,
        typer.Option(
            "-d", "--max-bag-duration", metavar="S", min=0.001, help="Then begin a new file."
        ),
    ] = None,
    max_files: Annotated[
        int | None,
        typer.Option("--max-bag-files", min=1, help="Keep so many files, remove the oldest."),
    ] = None,
    compression: CompressionOption = CompressionName.ZSTD,
    chunk_size: ChunkSizeOption = "4MiB",
    cache_size: Annotated[
        str, typer.Option("--max-cache-size", metavar="SIZE", help="What may wait for the disk.")
    ] = "100MiB",
    min_free: Annotated[
        str, typer.Option("--min-free", metavar="SIZE", help="End before the disk has less room.")
    ] = "100MB",
    attach: Annotated[
        list[Path] | None,
        typer.Option("--attach", metavar="FILE", help="A file that travels along: a URDF, a map."),
    ] = None,
    custom: Annotated[
        list[str] | None,
        typer.Option("--custom-data", metavar="KEY=VALUE", help="A fact about the recording."),
    ] = None,
    sim_time: Annotated[
        bool, typer.Option("--use-sim-time", help="Times are those of /clock; wait for it.")
    ] = False,
    paused: Annotated[
        bool, typer.Option("-p", "--start-paused", help="Begin when space is pressed.")
    ] = False,
    snapshot: Annotated[
        bool,
        typer.Option(
            "--snapshot-mode",
            help="Keep the last --max-cache-size of messages; write them on key s or SIGUSR1.",
        ),
    ] = False,
    master: MasterOption = None,
) -> None:
    """Record topics into a file, until Ctrl-C; topics that begin later, too.

    The file is called FILE.active until it is complete. In a terminal, space pauses and goes on.
    """
    from simple_ros import aio
    from simple_ros.bag import Attached, SeriesOptions, SplitRule, TopicSelection

    selection = TopicSelection.made(topics or (), every=every, pattern=regex, exclude=exclude)
    if selection.is_empty:
        raise typer.BadParameter("name topics, or -a for all, or -e for those that fit")
    split = SplitRule(size_of(max_size) if max_size else None, max_duration)
    if max_files is not None and not split.is_on:
        raise typer.BadParameter("--max-bag-files goes with --max-bag-size or --max-bag-duration")
    options = SeriesOptions(
        _named(output),
        compression.value,
        size_of(chunk_size),
        split,
        max_files,
        0 if min_free == "0" else size_of(min_free),
        _facts(),
        pairs_of(custom or (), "--custom-data"),
        [Attached(path.name, _media_type(path), _content(path)) for path in attach or ()],
    )
    session = _Session(selection, options, size_of(cache_size), sim_time, paused, snapshot)
    # The thread that writes and the loop that receives share the interpreter: short turns keep the
    # times of arrival true.
    sys.setswitchinterval(0.001)
    aio.run(session.run(master))
    if session.failure is not None:
        raise session.failure


class _Session:
    """One run of the command."""

    def __init__(
        self,
        selection: TopicSelection,
        options: SeriesOptions,
        cache_bytes: int,
        sim_time: bool,
        paused: bool,
        snapshot: bool,
    ) -> None:
        self.failure: Exception | None = None
        self._selection = selection
        self._options = options
        self._cache_bytes = cache_bytes
        self._sim_time = sim_time
        self._paused = paused
        self._snapshot = snapshot

    async def run(self, master: str | None) -> None:
        from simple_ros.bag import Recorder
        from simple_ros.cli.topic.following import cli_node, while_running
        from simple_ros.net.master_client import MasterClient

        async with MasterClient(master) as client:
            await client.get_topics()  # a node would wait for its Master; here its absence is told
        async with cli_node("bag_record", master) as node:
            clock = await self._clock(node)
            recorder = Recorder(
                node,
                self._selection,
                self._options,
                max_cache_bytes=self._cache_bytes,
                clock=clock,
                paused=self._paused,
                snapshot=self._snapshot,
                on_topic=_tell_topic,
                on_file=lambda path: say(f"recording into {path}"),
            )
            try:
                await while_running(node, self._work(recorder))
            finally:
                summary = await recorder.stop()
                self.failure = summary.failure
                _tell(summary)

    async def _clock(self, node: NodeHandle) -> Callable[[], int]:
        import time

        if not self._sim_time:
            return time.time_ns
        clock = node.clock
        say("waiting for /clock")
        clock.use_sim_time(True)
        await clock.wait_for_clock()
        return lambda: clock.now().nanoseconds

    async def _work(self, recorder: Recorder) -> None:
        from simple_ros.cli.bag.keyboard import SPACE, keys_do

        def toggle() -> None:
            recorder.is_paused = not recorder.is_paused
            say("paused" if recorder.is_paused else "recording")

        def take() -> None:
            say(f"snapshot of {counted(recorder.take_snapshot())}")

        loop = asyncio.get_running_loop()
        if self._snapshot:
            loop.add_signal_handler(signal.SIGUSR1, take)
        try:
            with keys_do({SPACE: toggle, "s": take if self._snapshot else toggle}):
                await recorder.wait()
        finally:
            if self._snapshot:
                loop.remove_signal_handler(signal.SIGUSR1)


def _tell_topic(topic: RecordedTopic) -> None:
    latched = ", latched" if topic.history is not None else ""
    say(f"  {topic.topic}  {topic.msg_type}{latched}")


def _tell(summary: RecordingSummary) -> None:
    size, count = size_text(summary.size_bytes), summary.messages
    names = ", ".join(map(str, summary.files)) or "nothing"
    say(f"wrote {names}: {counted(count)}, {size}")
    for topic, dropped in sorted(summary.drops.items()):
        print(f"warning: {counted(dropped)} of {topic!r} not written", file=sys.stderr)


def _named(output: Path | None) -> Path:
    if output is None:
        return Path(datetime.now().astimezone().strftime("bag_%Y-%m-%d_%H-%M-%S.mcap"))
    if not output.parent.is_dir():
        raise ConfigError(f"there is no directory {output.parent}")
    return output if output.suffix == ".mcap" else output.with_name(f"{output.name}.mcap")


def _content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise ConfigError(f"--attach {path}: {error.strerror or error}") from None


def _media_type(path: Path) -> str:
    return _MEDIA_TYPES.get(path.suffix.lower(), "application/octet-stream")


def _facts() -> dict[str, str]:
    """How the recording came about."""
    from importlib.metadata import version

    facts = {
        "command": shlex.join(["simple-ros", *sys.argv[1:]]),
        "host": platform.node(),
        "started": datetime.now(UTC).isoformat(timespec="milliseconds"),
        "user": _user(),
        "version": version("simple-ros"),
    }
    revision = _git_revision()
    return facts | {"git": revision} if revision else facts


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a number without a name, as in containers
        return ""


def _git_revision() -> str:
    """The commit of the present directory, marked if files were changed; empty if there is none."""
    command = ("git", "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*")
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=2, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""
