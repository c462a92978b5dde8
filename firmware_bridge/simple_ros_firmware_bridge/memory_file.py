"""What is remembered of boards, on disk: one small file a port."""

from __future__ import annotations

import json
import logging
import os
import re
from pathlib import Path
from typing import Any

__all__ = ["MemoryFile", "default_directory"]

logger = logging.getLogger(__name__)


def default_directory() -> Path:
    """Where it is kept if nobody says: below ``$XDG_STATE_HOME``, else ``~/.local/state``."""
    base = os.environ.get("XDG_STATE_HOME", "") or Path.home() / ".local" / "state"
    return Path(base) / "simple_ros" / "pico"


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
