"""The guard's owner: tells it which process groups to end if this process is killed."""

from __future__ import annotations

import asyncio
import contextlib
import sys
from asyncio.subprocess import DEVNULL, PIPE, Process

from simple_ros.launch import guard

__all__ = ["Guard"]


class Guard:
    """A `guard` process, started with the first group."""

    def __init__(self) -> None:
        self._process: Process | None = None
        self._starting = asyncio.Lock()

    async def watch(self, group: int) -> None:
        """End this group if we are killed."""
        async with self._starting:
            if self._process is None:
                self._process = await asyncio.create_subprocess_exec(
                    sys.executable,
                    "-IS",
                    guard.__file__,
                    stdin=PIPE,
                    stdout=DEVNULL,
                    stderr=DEVNULL,
                    process_group=0,
                )
        self._tell(f"+{group}\n")

    def forget(self, group: int) -> None:
        """This group is gone."""
        self._tell(f"-{group}\n")

    def _tell(self, line: str) -> None:
        process = self._process
        if process is not None and process.returncode is None and process.stdin is not None:
            process.stdin.write(line.encode())

    async def close(self) -> None:
        """End the guard; every group must be gone."""
        process, self._process = self._process, None
        if process is not None and process.stdin is not None:
            process.stdin.close()
            # It may have been killed by somebody.
            with contextlib.suppress(ConnectionError):
                await process.stdin.wait_closed()
            await process.wait()
