"""Calling user code without letting it hurt anybody else."""

from __future__ import annotations

import asyncio
import inspect
import logging
import time
from collections.abc import Callable
from typing import Any

from simple_ros.errors import HandleClosed

__all__ = ["CALLBACK_ERRORS", "CallbackGuard", "is_async", "is_being_cancelled"]

logger = logging.getLogger(__name__)

_LOG_EVERY_S = 1.0

CALLBACK_ERRORS = (Exception, asyncio.CancelledError)
"""What may come out of a plain callback; it may well look at a future that was cancelled."""


def is_async(callback: object) -> bool:
    """Whether calling it gives something to await."""
    return inspect.iscoroutinefunction(callback) or inspect.iscoroutinefunction(
        getattr(callback, "__call__", None)  # noqa: B004
    )


def is_being_cancelled() -> bool:
    """Whether a CancelledError is meant for the running task, not something it awaited."""
    task = asyncio.current_task()
    return task is not None and task.cancelling() > 0


class CallbackGuard:
    """Counts the exceptions of one callback and logs them with traceback, at most one a second.

    Attributes:
        errors: Exceptions so far.
    """

    __slots__ = ("_label", "_logged_at", "_unlogged", "errors")

    def __init__(self, label: str) -> None:
        self.errors = 0
        self._label = label
        self._logged_at = float("-inf")
        self._unlogged = 0

    def call(self, callback: Callable[..., Any], *args: Any) -> None:
        """Call; an exception ends here."""
        try:
            callback(*args)
        except CALLBACK_ERRORS as error:
            self.failed(error)

    def failed(self, error: BaseException) -> None:
        """Note an exception of the callback."""
        self.errors += 1
        if isinstance(error, HandleClosed):
            # Ordinary at the end of a node: its callbacks run until the last handle is closed.
            logger.info("callback of %s: %s", self._label, error)
            return
        now = time.monotonic()
        if now - self._logged_at < _LOG_EVERY_S:
            self._unlogged += 1
            return
        more = f" ({self._unlogged} more since the last report)" if self._unlogged else ""
        logger.error("callback of %s raised%s", self._label, more, exc_info=error)
        self._logged_at = now
        self._unlogged = 0
