"""Keeping an event loop awake: it looks for messages all the time instead of sleeping until one comes.

Waking a sleeping thread takes the kernel longer than everything that is done for a small message. A loop that
never sleeps answers in about half the time, and uses one core whole.
"""

from __future__ import annotations

import asyncio
import os
import sys
from typing import Self
from weakref import WeakKeyDictionary

__all__ = ["BusyPoll", "is_wanted"]

_SWITCH_S = 200e-6

_polled: WeakKeyDictionary[asyncio.AbstractEventLoop, BusyPoll] = WeakKeyDictionary()


def is_wanted() -> bool:
    """Whether ``SIMPLE_ROS_BUSY_POLL`` says so: anything but nothing and ``0``."""
    return os.environ.get("SIMPLE_ROS_BUSY_POLL", "0") not in ("", "0")


class BusyPoll:
    """Keeps one event loop awake, as long as anybody wants it.

    Args:
        loop: The loop.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._users = 0
        self._turns = False
        self._interval = sys.getswitchinterval()

    @classmethod
    def of(cls, loop: asyncio.AbstractEventLoop) -> BusyPoll:
        """The one of a loop."""
        return _polled.setdefault(loop, cls(loop))

    @property
    def is_on(self) -> bool:
        """Whether the loop is kept awake."""
        return self._users > 0

    def acquire(self) -> Self:
        """Keep the loop awake until `release` is called as often."""
        self._users += 1
        if self._users == 1:
            self._interval = sys.getswitchinterval()
            # A thread that never sleeps gives the interpreter to others only when they insist: sooner, then.
            sys.setswitchinterval(min(self._interval, _SWITCH_S))
        if not self._turns:
            self._turns = True
            self._loop.call_soon(self._turn)
        return self

    def release(self) -> None:
        """One user less."""
        self._users -= 1
        if not self._users:
            sys.setswitchinterval(self._interval)

    def _turn(self) -> None:
        # Something is always due, so the loop asks the kernel what is there, and never waits.
        self._turns = self._users > 0
        if self._turns:
            self._loop.call_soon(self._turn)
