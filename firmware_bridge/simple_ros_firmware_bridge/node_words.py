"""Words for the node (``__name:=``, ``_gain:=``) on the command line of a program that has options of its own."""

from __future__ import annotations

import os
import shlex
from collections.abc import Sequence
from typing import Annotated

import typer

from simple_ros.arguments import ENVIRONMENT, use_environment_only

__all__ = ["Words", "take_words"]

Words = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[WORD:=VALUE]...",
        help="Words for the node: __name:=, __ns:=, _parameter:=, from:=to.",
        show_default=False,
    ),
]


def take_words(words: Sequence[str] | None) -> None:
    """Let the node of this process have these words, and nothing else of the command line.

    What stands behind an option, as in ``--remap odom:=wheels``, is the option's and no word.

    Raises:
        typer.BadParameter: One of them has no ``:=``.
    """
    use_environment_only()
    for word in words or ():
        if ":=" not in word:
            raise typer.BadParameter(f"{word!r} is no word for a node: it has no ':='")
    if words:
        given = os.environ.get(ENVIRONMENT, "")
        os.environ[ENVIRONMENT] = f"{given} {shlex.join(words)}".strip()
