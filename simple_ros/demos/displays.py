"""Where a demo is shown: a live screen, or one line a second for logs and pipes."""

from __future__ import annotations

import os
import sys
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.live import Live

from simple_ros.demos.quad_demo_view import DemoState, plain_line, screen

__all__ = ["LiveDisplay", "PlainDisplay", "suitable_display"]

_SMALLEST_COLUMNS = 72
_SMALLEST_ROWS = 20


class PlainDisplay:
    """Prints one line a second."""

    period_s = 1.0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def say(self, line: str) -> None:
        """Print a line."""
        print(line, flush=True)

    def show(self, state: DemoState) -> None:
        """Print what is known."""
        self.say(plain_line(state))


class LiveDisplay:
    """Fills the terminal and gives it back as it was."""

    period_s = 0.2

    def __init__(self, console: Console) -> None:
        self._console = console
        self._live = Live(console=console, screen=True, auto_refresh=False)
        self._braille = console.encoding.startswith("utf") and os.environ.get("TERM") != "linux"

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._live.__exit__(kind, error, traceback)

    def say(self, line: str) -> None:
        """Nothing: the screen has a place for it."""

    def show(self, state: DemoState) -> None:
        """Draw what is known."""
        self._live.start()
        columns, rows = self._console.size
        picture = screen(state, columns, rows, braille=self._braille)
        self._live.update(picture, refresh=True)


def suitable_display(*, plain: bool) -> PlainDisplay | LiveDisplay:
    """Live on a terminal that is large enough, unless ``plain`` is wanted."""
    console = Console()
    columns, rows = console.size
    large = columns >= _SMALLEST_COLUMNS and rows >= _SMALLEST_ROWS
    # Colours may be forced upon a pipe; that makes it no terminal.
    if plain or not large or not sys.stdout.isatty() or console.is_dumb_terminal:
        return PlainDisplay()
    return LiveDisplay(console)
