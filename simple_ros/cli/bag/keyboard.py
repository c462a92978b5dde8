"""Single keys of the terminal."""

from __future__ import annotations

import asyncio
import os
import sys
import termios
import tty
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

__all__ = ["DOWN", "LEFT", "RIGHT", "SPACE", "UP", "keys_do", "keys_in"]

SPACE = " "
UP, DOWN, RIGHT, LEFT = "\x1b[A", "\x1b[B", "\x1b[C", "\x1b[D"


def keys_in(text: str) -> list[str]:
    """The keys of what a terminal sent: characters, and arrows as three of them."""
    found = []
    position = 0
    while position < len(text):
        length = 3 if text.startswith("\x1b[", position) else 1
        found.append(text[position : position + length])
        position += length
    return found


@contextmanager
def keys_do(actions: Mapping[str, Callable[[], None]]) -> Iterator[bool]:
    """Call an action when its key is pressed; gives whether there is a keyboard at all.

    Ctrl-C and Ctrl-Z work as ever. In the background of a shell there is no keyboard.
    """
    if not _is_ours():
        yield False
        return
    descriptor = sys.stdin.fileno()
    loop = asyncio.get_running_loop()
    before = termios.tcgetattr(descriptor)

    def readable() -> None:
        data = os.read(descriptor, 1024)
        if not data:
            loop.remove_reader(descriptor)
        for key in keys_in(data.decode("utf-8", "replace")):
            action = actions.get(key)
            if action is not None:
                action()

    tty.setcbreak(descriptor)
    loop.add_reader(descriptor, readable)
    try:
        yield True
    finally:
        loop.remove_reader(descriptor)
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


def _is_ours() -> bool:
    try:
        descriptor = sys.stdin.fileno()
        return os.isatty(descriptor) and os.tcgetpgrp(descriptor) == os.getpgrp()
    except (OSError, ValueError, AttributeError):
        return False
