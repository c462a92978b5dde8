"""Where measurements appear: as lines, as a table that stays in its place, as C++ rostopic.

A display is a context that gives a function to show the windows of all topics, again and again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import TYPE_CHECKING

from simple_ros.cli.measurements import cpp_rate_text
from simple_ros.cli.text import columns, json_line, put, say
from simple_ros.cli.topic.quantities import NOTHING_NEW, TOO_FEW, Quantity, Window

if TYPE_CHECKING:
    from rich.table import Table

__all__ = ["Display", "cpp_rates", "json_lines", "lines", "live_table"]

Show = Callable[[Sequence[Window]], None]
Display = AbstractContextManager[Show]


def lines(quantity: Quantity) -> Display:
    """A line for each topic, with its name if there are several."""

    def text(window: Window) -> str:
        if not window.look():
            return NOTHING_NEW
        facts = quantity.facts(window)
        return TOO_FEW if facts is None else quantity.line(facts)

    def show(windows: Sequence[Window]) -> None:
        rows = [(window.topic, text(window)) for window in windows]
        say(columns(rows) if len(rows) > 1 else rows[0][1])

    return nullcontext(show)


def json_lines(quantity: Quantity) -> Display:
    """A JSON document for each topic with new messages."""

    def show(windows: Sequence[Window]) -> None:
        for window in windows:
            facts = quantity.facts(window) if window.look() else None
            if facts is not None:
                say(json_line({"topic": window.topic} | facts))

    return nullcontext(show)


def cpp_rates() -> Display:
    """What ``rostopic hz`` prints: one line that is written over, whether or not anything came."""

    def show(windows: Sequence[Window]) -> None:
        (window,) = windows
        text = cpp_rate_text(list(window.times))
        if text is not None:
            put(text)

    return nullcontext(show)


@contextmanager
def live_table(quantity: Quantity) -> Iterator[Show]:
    """A row for each topic, in place; the last table stays."""
    from rich.live import Live

    with Live(auto_refresh=False) as live:
        yield lambda windows: live.update(_table(quantity, windows), refresh=True)


def _table(quantity: Quantity, windows: Sequence[Window]) -> Table:
    from rich.table import Table
    from rich.text import Text

    table = Table("topic", box=None, pad_edge=False)
    for title in quantity.titles:
        table.add_column(title, justify="right")
    for window in windows:
        name = Text(window.topic)
        facts = quantity.facts(window)
        if window.look() and facts is not None:
            table.add_row(name, *quantity.cells(facts))
        else:
            table.add_row(name, TOO_FEW if facts is None and window.times else NOTHING_NEW)
    return table
