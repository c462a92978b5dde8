"""What a process takes, measured from outside."""

from __future__ import annotations

from dataclasses import dataclass

import psutil

__all__ = ["Usage", "UsageMeter"]


@dataclass(frozen=True, slots=True)
class Usage:
    """What a process takes: share of one core in percent, resident memory in bytes."""

    cpu_percent: float
    memory_bytes: int


class UsageMeter:
    """Measures a process from outside."""

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self._process: psutil.Process | None = None

    def usage(self) -> Usage | None:
        """CPU since the last call (0 at the first), memory now; None when it has ended."""
        try:
            if self._process is None:
                self._process = psutil.Process(self._pid)
            return Usage(self._process.cpu_percent(), self._process.memory_info().rss)
        except psutil.Error:
            return None
