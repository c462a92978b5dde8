"""What is open at the network, in a file: so that a program that was killed can be cleaned up after."""

from __future__ import annotations

import json
import logging
import os
import tempfile
from pathlib import Path

__all__ = ["Journal"]

logger = logging.getLogger(__name__)


class Journal:
    """The URLs that are open.

    Args:
        path: The file; empty for none.
    """

    def __init__(self, path: str) -> None:
        self._path = Path(path) if path else None
        self._written: list[str] | None = None

    def read(self) -> list[str]:
        """What an earlier program left open."""
        if self._path is None or not self._path.exists():
            return []
        try:
            urls = json.loads(self._path.read_text("utf-8"))
        except (OSError, ValueError) as error:
            logger.warning("%s cannot be read, nothing is cleaned up: %s", self._path, error)
            return []
        return [url for url in urls if isinstance(url, str)] if isinstance(urls, list) else []

    def write(self, urls: list[str]) -> None:
        """Keep what is open now, in one step, so that nobody reads half of it."""
        if self._path is None or urls == self._written:
            return
        self._written = list(urls)
        try:
            handle, name = tempfile.mkstemp(dir=self._path.parent, prefix=self._path.name)
            with os.fdopen(handle, "w", encoding="utf-8") as file:
                json.dump(urls, file)
            Path(name).replace(self._path)
        except OSError as error:
            logger.warning("%s cannot be written: %s", self._path, error)
