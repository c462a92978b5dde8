"""The journal on disk: what happened, each once, also over the death of a hub."""

from __future__ import annotations

import contextlib
import json
import logging
import os
from pathlib import Path

from simple_ros_hub.journal import Entry

__all__ = ["EventLog"]

logger = logging.getLogger(__name__)

_NAME = "events.jsonl"
_KEYS = ("number", "stamp_ns", "component", "text", "is_error")


class EventLog:
    """One line of JSON for each entry, written before anybody is told.

    A line is written by one call, so a hub that is killed leaves a whole line or none. A file that is full
    is kept as ``events.jsonl.1``, one generation.

    Args:
        directory: The hub's.
        max_bytes: Of one file.
    """

    def __init__(self, directory: Path, max_bytes: int = 2_000_000) -> None:
        self._path = directory / _NAME
        self._max_bytes = max_bytes
        self._is_broken = False

    def read(self, keep: int) -> list[Entry]:
        """The newest entries, oldest first; what cannot be read is left out."""
        found: list[Entry] = []
        for path in (self._older, self._path):
            with contextlib.suppress(FileNotFoundError):
                lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
                found += [entry for line in lines if (entry := _entry(line)) is not None]
        return found[-keep:]

    def append(self, entry: Entry) -> None:
        """Write one; a full disk is logged once, and what is not written is missing later."""
        values = {name: getattr(entry, name) for name in _KEYS}
        try:
            self._write(json.dumps(values, ensure_ascii=False).encode() + b"\n")
        except OSError as error:
            if not self._is_broken:
                logger.warning("events are not kept in %s: %s", self._path, error.strerror)
            self._is_broken = True
        else:
            self._is_broken = False

    @property
    def _older(self) -> Path:
        return self._path.with_name(f"{_NAME}.1")

    def _write(self, line: bytes) -> None:
        file = os.open(self._path, os.O_RDWR | os.O_APPEND | os.O_CREAT, 0o644)
        try:
            size = os.fstat(file).st_size
            if size and os.pread(file, 1, size - 1) != b"\n":
                # What a full disk left half written must not spoil this one.
                line = b"\n" + line
            os.write(file, line)
        finally:
            os.close(file)
        if size + len(line) > self._max_bytes:
            self._path.replace(self._older)


def _entry(line: str) -> Entry | None:
    try:
        values = json.loads(line)
        return Entry(
            int(values["number"]),
            int(values["stamp_ns"]),
            str(values["component"]),
            str(values["text"]),
            bool(values["is_error"]),
        )
    except (ValueError, KeyError, TypeError):
        return None
