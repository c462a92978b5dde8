"""What is remembered of boards, on disk: one small file a serial port, one for all boards of a network port."""

from __future__ import annotations

import json
import logging
import os
import re
from pathlib import Path
from typing import Any, Protocol

__all__ = ["Memory", "MemoryBook", "MemoryFile", "default_directory"]

logger = logging.getLogger(__name__)

_MAX_PAGES = 64


def default_directory() -> Path:
    """Where it is kept if nobody says: below ``$XDG_STATE_HOME``, else ``~/.local/state``."""
    base = os.environ.get("XDG_STATE_HOME", "") or Path.home() / ".local" / "state"
    return Path(base) / "simple_ros" / "pico"


class Memory(Protocol):
    """Where the session of one board is kept."""

    def load(self) -> dict[str, Any] | None:
        """What was kept; None if nothing was, or nothing sensible."""

    def keep(self, content: dict[str, Any] | None) -> None:
        """Keep this; None forgets."""


class MemoryFile:
    """The file of one port.

    Args:
        directory: Where; None keeps nothing.
        port: Path of the port, best one below ``/dev/serial/by-id``.
    """

    def __init__(self, directory: Path | None, port: str) -> None:
        name = re.sub(r"[^A-Za-z0-9_.-]+", "_", port).strip("_")
        self._path = None if directory is None else directory / f"{name}.json"
        self._written: dict[str, Any] | None = None

    def load(self) -> dict[str, Any] | None:
        """What was kept; None if nothing was, or nothing sensible."""
        if self._path is None:
            return None
        try:
            content = json.loads(self._path.read_text())
        except FileNotFoundError:
            return None
        except (OSError, ValueError) as error:
            logger.warning(
                "%s cannot be read (%s); boards will have to be reset", self._path, error
            )
            return None
        self._written = content if isinstance(content, dict) else None
        return self._written

    def keep(self, content: dict[str, Any] | None) -> None:
        """Keep this, whole or not at all; None forgets."""
        if self._path is None or content == self._written:
            return
        try:
            if content is None:
                self._path.unlink(missing_ok=True)
            else:
                self._path.parent.mkdir(parents=True, exist_ok=True)
                part = self._path.with_suffix(".part")
                part.write_text(json.dumps(content))
                part.replace(self._path)
        except OSError as error:
            logger.warning("%s cannot be written: %s", self._path, error)
        self._written = content


class MemoryBook:
    """Sessions of many boards in one file, by address. Of more than 64 the oldest are forgotten.

    Args:
        directory: Where; None keeps them for the time of the process only.
        name: Of the file.
    """

    def __init__(self, directory: Path | None, name: str) -> None:
        self._file = MemoryFile(directory, name)
        found = self._file.load() or {}
        self._pages = {text: page for text, page in found.items() if isinstance(page, dict)}

    def addresses(self) -> list[str]:
        """Of whom there is something."""
        return list(self._pages)

    def page(self, address: str) -> Memory:
        """The memory of one board."""
        return _Page(self, address)

    def read(self, address: str) -> dict[str, Any] | None:
        """What was kept of a board."""
        return self._pages.get(address)

    def write(self, address: str, content: dict[str, Any] | None) -> None:
        """Keep this of a board; None forgets.

        A board that was at another port of its host before is known by its key, and forgotten there.
        """
        if self._pages.get(address) == content:
            return
        key = None if content is None else content.get("key")

        def is_same(text: str, page: dict[str, Any]) -> bool:
            is_same_key = key is not None and page.get("key") == key
            return is_same_key and _host(text) == _host(address)

        self._pages.pop(address, None)
        if content is not None:
            for other in [text for text, page in self._pages.items() if is_same(text, page)]:
                del self._pages[other]
            self._pages[address] = content
        while len(self._pages) > _MAX_PAGES:
            del self._pages[next(iter(self._pages))]
        self._file.keep(dict(self._pages) or None)

    def move(self, old: str, new: str) -> None:
        """The board at ``old`` is at ``new`` now."""
        content = self._pages.pop(old, None)
        self.write(new, content)


def _host(address: str) -> str:
    return address.rpartition(":")[0]


class _Page:
    def __init__(self, book: MemoryBook, address: str) -> None:
        self._book = book
        self._address = address

    def load(self) -> dict[str, Any] | None:
        return self._book.read(self._address)

    def keep(self, content: dict[str, Any] | None) -> None:
        self._book.write(self._address, content)
