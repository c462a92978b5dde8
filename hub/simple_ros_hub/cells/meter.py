"""CPU and memory of this process, from ``/proc``."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

__all__ = ["ResourceMeter", "Resources"]

_TICK_S = 1 / os.sysconf("SC_CLK_TCK")
_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")


@dataclass(frozen=True, slots=True)
class Resources:
    """What a process takes.

    Attributes:
        cpu_percent: Of one core, since the last reading; 0 at the first.
        memory_bytes: Resident.
        threads: How many.
    """

    cpu_percent: float
    memory_bytes: int
    threads: int


class ResourceMeter:
    """Reads ``stat`` and ``statm`` of a process.

    Args:
        directory: Of the process.
    """

    def __init__(self, directory: Path = Path("/proc/self")) -> None:
        self._directory = directory
        self._before: tuple[float, float] | None = None

    def read(self, now_s: float) -> Resources:
        """What it takes now.

        Args:
            now_s: Any clock that only goes forward.
        """
        # The second field is the program's name, which may have spaces and brackets in it.
        fields = (self._directory / "stat").read_text().rpartition(")")[2].split()
        used_s = (int(fields[11]) + int(fields[12])) * _TICK_S
        pages = int((self._directory / "statm").read_text().split()[1])
        percent = 0.0
        if self._before is not None and now_s > self._before[0]:
            percent = 100 * (used_s - self._before[1]) / (now_s - self._before[0])
        self._before = (now_s, used_s)
        return Resources(percent, pages * _PAGE_BYTES, int(fields[17]))
