"""A place on the screen that is drawn anew: a table in a terminal, text elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Self

from simple_ros.cli.text import say

if TYPE_CHECKING:
    from rich.console import RenderableType

__all__ = ["Place"]


class Place:
    """Where a command shows the same thing again and again.

    Args:
        live: Whether to draw in place, if the output is a terminal.
    """

    def __init__(self, *, live: bool = True) -> None:
        self._live = None
        if live and sys.stdout.isatty():
            from rich.live import Live

            self._live = Live(auto_refresh=False)

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()

    def show(self, text: Callable[[], str], table: Callable[[], RenderableType]) -> None:
        """Draw the table, or print the text; only that which is needed is made."""
        if self._live is not None:
            self._live.update(table(), refresh=True)
        else:
            say(text())
