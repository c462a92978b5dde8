"""Text on the screen: the same units, columns and JSON for every command.

Only `say` and `put` do anything.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from typing import Any

import typer

__all__ = ["columns", "duration_text", "json_line", "one_line", "put", "say", "size_text"]


def say(text: str) -> None:
    """Print lines at once; end quietly when nobody reads any more (``| head``)."""
    put(text.removesuffix("\n") + "\n")


def put(text: str) -> None:
    """Print as `say` does, and no more than the text."""
    try:
        print(text, end="", flush=True)
    except BrokenPipeError:
        # Otherwise the interpreter complains when it flushes once more at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise typer.Exit from None


def columns(rows: Sequence[Sequence[str]]) -> str:
    """Rows of cells as text in which every column begins at the same place."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)
    return "\n".join(lines)


def json_line(value: Any) -> str:
    """A JSON document in one line."""
    return json.dumps(value, ensure_ascii=False)


def one_line(text: str) -> str:
    """Text without line breaks."""
    return " ".join(text.split())


def duration_text(seconds: float) -> str:
    """Seconds in a handy unit."""
    if abs(seconds) >= 1:
        return f"{seconds:.3f} s"
    return f"{seconds * 1e3:.3f} ms"


def size_text(count: float) -> str:
    """Bytes in a handy unit, of 1000."""
    for unit in ("B", "kB", "MB"):
        if count < 1000:
            return f"{count:.0f} B" if unit == "B" else f"{count:.2f} {unit}"
        count /= 1000
    return f"{count:.2f} GB"
