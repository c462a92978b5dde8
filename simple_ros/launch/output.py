"""The output of a process, line by line."""

from __future__ import annotations

import asyncio
import os
from collections import deque
from collections.abc import Callable, Sequence

__all__ = ["KEPT_LINES", "LineSplitter", "Output"]

KEPT_LINES = 20
_READ_BYTES = 65536


class LineSplitter:
    """Cuts bytes into lines of text: pure. A line longer than ``limit`` bytes is cut there."""

    def __init__(self, limit: int = _READ_BYTES) -> None:
        self._limit = limit
        self._rest = b""

    def feed(self, data: bytes) -> list[str]:
        """The lines that are whole now, without their ends."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        while len(self._rest) > self._limit:
            lines.append(self._rest[: self._limit])
            self._rest = self._rest[self._limit :]
        return [_text(line) for line in lines]

    def finish(self) -> list[str]:
        """What stands behind the last end of a line."""
        rest, self._rest = self._rest, b""
        return [_text(rest)] if rest else []


def _text(line: bytes) -> str:
    return line.decode(errors="replace").rstrip("\r")


class Output:
    """Reads the end of a pipe of ours; keeps the last lines, hands on all.

    Args:
        on_lines: Called with lines as they come.
    """

    def __init__(self, on_lines: Callable[[Sequence[str]], None] | None = None) -> None:
        self.lines: deque[str] = deque(maxlen=KEPT_LINES)
        self._on_lines = on_lines
        self._changed = asyncio.Event()
        self._ended = asyncio.Event()
        self._transport: asyncio.ReadTransport | None = None

    async def open(self) -> int:
        """Begin to read; returns the other end of the pipe, which the caller closes."""
        reading, writing = os.pipe()
        loop = asyncio.get_running_loop()
        pipe = os.fdopen(reading, "rb", 0)
        self._transport, _ = await loop.connect_read_pipe(lambda: _Reading(self), pipe)
        return writing

    def feed(self, data: bytes, splitter: LineSplitter) -> None:
        """Bytes came."""
        self._add(splitter.feed(data))

    def finish(self, splitter: LineSplitter) -> None:
        """No more will come."""
        self._add(splitter.finish())
        self._ended.set()
        self._changed.set()

    def _add(self, lines: Sequence[str]) -> None:
        if lines:
            self.lines.extend(line.rstrip() for line in lines if line.strip())
            self._changed.set()
            if self._on_lines is not None:
                self._on_lines(lines)

    async def line_with(self, text: str) -> str | None:
        """The first kept line that contains ``text``; waits for it. None if the output ended."""
        while True:
            found = next((line for line in self.lines if text in line), None)
            if found is not None or self._ended.is_set():
                return found
            self._changed.clear()
            await self._changed.wait()

    async def close(self, patience_s: float) -> None:
        """Read what is left, for so long at most: somebody else may hold the pipe open for ever."""
        try:
            async with asyncio.timeout(patience_s):
                await self._ended.wait()
        except TimeoutError:
            if self._transport is not None:
                self._transport.close()


class _Reading(asyncio.Protocol):
    """Hands what is read to an `Output`."""

    def __init__(self, output: Output) -> None:
        self._output = output
        self._splitter = LineSplitter()

    def data_received(self, data: bytes) -> None:
        """Bytes came."""
        self._output.feed(data, self._splitter)

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002
        """The pipe is closed."""
        self._output.finish(self._splitter)
