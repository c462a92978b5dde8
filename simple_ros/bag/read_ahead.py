"""Reading ahead in a thread, so that playback never waits for the disk."""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import Iterator
from typing import Generic, TypeVar

__all__ = ["ReadAhead"]

Item = TypeVar("Item")
_PIECE = 64
_PIECES = 64


class ReadAhead(Generic[Item]):
    """Takes from an iterator in a thread; what waits is bounded in items.

    Args:
        source: What is read; used by the thread only.
    """

    def __init__(self, source: Iterator[Item]) -> None:
        self._source = source
        self._loop = asyncio.get_running_loop()
        self._pieces: deque[list[Item]] = deque()
        self._current: deque[Item] = deque()
        self._room = threading.Condition()
        self._arrived = asyncio.Event()
        self._done = False
        self._failure: BaseException | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="bag reader", daemon=True)
        self._thread.start()

    async def peek(self) -> Item | None:
        """The next item, which stays; None at the end.

        Raises:
            Exception: What the iterator raised, after the items before.
        """
        while not self._current:
            self._arrived.clear()
            with self._room:
                if self._pieces:
                    self._current.extend(self._pieces.popleft())
                    self._room.notify()
                    continue
                if self._done:
                    if self._failure is not None:
                        raise self._failure
                    return None
            await self._arrived.wait()
        return self._current[0]

    def ready(self) -> Item | None:
        """The next item, which stays, if it is there already."""
        return self._current[0] if self._current else None

    def take(self) -> None:
        """Remove the next item."""
        self._current.popleft()

    async def close(self) -> None:
        """End the thread."""
        with self._room:
            self._closed = True
            self._room.notify()
        await self._loop.run_in_executor(None, self._thread.join)

    def _run(self) -> None:
        try:
            self._read()
        except Exception as error:
            self._failure = error
        finally:
            with self._room:
                self._done = True
            self._tell()

    def _read(self) -> None:
        piece: list[Item] = []
        for item in self._source:
            piece.append(item)
            if len(piece) >= _PIECE:
                if not self._put(piece):
                    return
                piece = []
        self._put(piece)

    def _put(self, piece: list[Item]) -> bool:
        with self._room:
            while len(self._pieces) >= _PIECES and not self._closed:
                self._room.wait()
            if self._closed:
                return False
            self._pieces.append(piece)
        self._tell()
        return True

    def _tell(self) -> None:
        # The loop may be gone when a program ends in the middle of a bag.
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._arrived.set)
