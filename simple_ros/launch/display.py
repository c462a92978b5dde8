"""How a launch looks: a live table on a terminal, one line an event elsewhere."""

from __future__ import annotations

import math
import os
import signal
import sys
from collections.abc import Sequence
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from simple_ros.launch.plan import State, Status
from simple_ros.launch.usage import Usage

__all__ = ["LiveDisplay", "PlainDisplay", "Rows", "suitable_display", "table"]

Rows = Sequence[tuple[Status, Usage | None, str]]
_COLOURS = {
    State.RUNNING: "green",
    State.STARTING: "cyan",
    State.WAITING: "cyan",
    State.RESTARTING: "yellow",
    State.STOPPING: "yellow",
    State.GIVEN_UP: "bold red",
}
_WITH_LAST_LINE_COLUMNS = 72


class PlainDisplay:
    """Prints one line an event."""

    period_s = math.inf

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def say(self, line: str, *, is_bad: bool = False) -> None:  # noqa: ARG002  (no colours here)
        """Print a line."""
        _print(line)

    def lines(self, name: str, lines: Sequence[str]) -> None:
        """Print them, each with the process's name."""
        _print("\n".join(f"[{name}] {line}" for line in lines))

    def show(self, rows: Rows) -> None:
        """Nothing: events have told it."""


def _print(text: str) -> None:
    try:
        print(text, flush=True)
    except BrokenPipeError:
        # Nobody reads any more (``| head``): end as if asked to, and print the rest to nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        os.kill(os.getpid(), signal.SIGTERM)


class LiveDisplay:
    """Keeps a table below what is printed, and leaves its last state."""

    period_s = 0.5

    def __init__(self, console: Console) -> None:
        self._console = console
        self._live = Live(console=console, auto_refresh=False, vertical_overflow="ellipsis")

    def __enter__(self) -> Self:
        self._live.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._live.__exit__(kind, error, traceback)

    def say(self, line: str, *, is_bad: bool = False) -> None:
        """Print a line above the table."""
        self._console.print(Text(line, style="red" if is_bad else ""))

    def lines(self, name: str, lines: Sequence[str]) -> None:
        """Print them above the table, each with the process's name."""
        self._console.print(Text("\n".join(f"[{name}] {line}" for line in lines)))

    def show(self, rows: Rows) -> None:
        """Draw the table."""
        self._live.update(table(rows, self._console.size.width), refresh=True)


def suitable_display(*, plain: bool) -> PlainDisplay | LiveDisplay:
    """Live on a terminal, unless ``plain`` is wanted."""
    console = Console()
    # Colours may be forced upon a pipe; that makes it no terminal.
    if plain or not sys.stdout.isatty() or console.is_dumb_terminal:
        return PlainDisplay()
    return LiveDisplay(console)


def table(rows: Rows, columns: int) -> Table:
    """The processes, as wide as the terminal."""
    result = Table(box=None, pad_edge=False, expand=True, header_style="bold")
    result.add_column("process", no_wrap=True)
    result.add_column("pid", justify="right", no_wrap=True)
    result.add_column("state", no_wrap=True)
    result.add_column("restarts", justify="right", no_wrap=True)
    result.add_column("cpu", justify="right", no_wrap=True)
    result.add_column("memory", justify="right", no_wrap=True)
    if columns >= _WITH_LAST_LINE_COLUMNS:
        result.add_column("last line", no_wrap=True, ratio=1, overflow="ellipsis")
    for status, usage, line in rows:
        colour = _COLOURS.get(status.state, "")
        cells: list[str | Text] = [
            status.name,
            str(status.pid or "-"),
            Text(status.state.value, style=colour),
            str(status.restarts),
            f"{usage.cpu_percent:.0f} %" if usage else "-",
            f"{usage.memory_bytes / 1e6:.0f} MB" if usage else "-",
        ]
        if columns >= _WITH_LAST_LINE_COLUMNS:
            cells.append(Text(status.detail or line, style=colour if status.detail else ""))
        result.add_row(*cells)
    return result
