"""Calling user code without letting it hurt anybody else."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import Any

__all__ = ["CallbackGuard"]

logger = logging.getLogger(__name__)

_LOG_EVERY_S = 1.0


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
        except Exception as error:
            self.failed(error)

    def failed(self, error: Exception) -> None:
        """Note an exception of the callback."""
        self.errors += 1
        now = time.monotonic()
        if now - self._logged_at < _LOG_EVERY_S:
            self._unlogged += 1
            return
        more = f" ({self._unlogged} more since the last report)" if self._unlogged else ""
        logger.error("callback of %s raised%s", self._label, more, exc_info=error)
        self._logged_at = now
        self._unlogged = 0
