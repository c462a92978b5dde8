"""The file in which a Master keeps what was set, so that a later one knows it."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
from collections.abc import Callable, Mapping
from pathlib import Path

from simple_ros.errors import ConfigError
from simple_ros.parameters.text import parse_tree, written
from simple_ros.parameters.values import Value

__all__ = ["ParameterStore", "replace_file"]

logger = logging.getLogger(__name__)

_GATHER_S = 0.2
_RETRY_S = 5.0


class ParameterStore:
    """Reads the file once, and writes it soon after changes and at the end.

    Args:
        path: Of a YAML file; it need not exist yet, its folder must.

    Raises:
        ConfigError: The file cannot be read, or its folder is not there.
        BadParameterText: It is no file of parameters; tells the line.
    """

    def __init__(self, path: Path) -> None:
        self._path = path.resolve()
        self._text = self._read(path)
        self.values = parse_tree(self._text, str(path))
        self._current: Callable[[], Mapping[str, Value]] = lambda: self.values
        self._dirty = asyncio.Event()
        self._ending = asyncio.Event()
        self._task: asyncio.Task[None] | None = None

    def _read(self, path: Path) -> str:
        try:
            return self._path.read_text(encoding="utf-8")
        except FileNotFoundError:
            if self._path.parent.is_dir():
                return ""
            raise ConfigError(f"parameter file {path}: there is no folder {path.parent}") from None
        except (OSError, UnicodeDecodeError) as error:
            reason = getattr(error, "strerror", None) or error
            raise ConfigError(f"parameter file {path} cannot be read: {reason}") from None

    def start(self, current: Callable[[], Mapping[str, Value]]) -> None:
        """Keep from now on what ``current`` gives."""
        self._current = current
        self._task = asyncio.get_running_loop().create_task(self._run(), name="parameter store")

    def changed(self) -> None:
        """There may be something to write."""
        self._dirty.set()

    async def _run(self) -> None:
        while not self._ending.is_set():
            await self._dirty.wait()
            await self._pause(_GATHER_S)
            self._dirty.clear()
            if not await self._write():
                await self._pause(_RETRY_S)
                self._dirty.set()

    async def _pause(self, seconds: float) -> None:
        """Wait so long, or until the end."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                await self._ending.wait()

    async def _write(self) -> bool:
        """Write, if anything is different; whether the file is up to date."""
        # In a thread: nodes must not wait for a large file.
        text = await asyncio.to_thread(written, dict(self._current()))
        if text == self._text:
            return True
        try:
            await asyncio.to_thread(replace_file, self._path, text)
        except OSError as error:
            logger.error("parameter file %s is not written: %s", self._path, error.strerror)  # noqa: TRY400
            return False
        self._text = text
        return True

    async def stop(self) -> None:
        """Write what is left."""
        if self._task is not None:
            self._ending.set()
            self._dirty.set()
            await self._task
            await self._write()


def replace_file(path: Path, text: str) -> None:
    """Give a file another content, which is there as a whole or not at all, also after a power cut."""
    draft = path.with_name(f".{path.name}.new")
    with draft.open("w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    draft.replace(path)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
