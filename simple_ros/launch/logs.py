"""Log files of launched processes, one directory a launch."""

from __future__ import annotations

import contextlib
import logging
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TextIO

from simple_ros.launch.errors import LaunchFailed

__all__ = ["LogFile", "new_log_directory"]

logger = logging.getLogger(__name__)

_LATEST = "latest"


def new_log_directory(title: str, now: float | None = None) -> Path:
    """Make a directory ``<time>-<title>`` and point ``latest`` at it.

    It is made in the directory ``SIMPLE_ROS_LOG_DIR``, or else in ``~/.simple_ros/log``.

    Args:
        title: What is launched.
        now: Seconds since 1970; None for now.

    Raises:
        LaunchFailed: It cannot be made.
    """
    wanted = os.environ.get("SIMPLE_ROS_LOG_DIR", "")
    root = Path(wanted).expanduser() if wanted else Path.home() / ".simple_ros" / "log"
    stamp = time.strftime("%Y-%m-%dT%H-%M-%S", time.localtime(now))
    try:
        root.mkdir(parents=True, exist_ok=True)
        directory = _made(root, f"{stamp}-{title}")
        _point(root / _LATEST, directory)
    except OSError as error:
        raise LaunchFailed(
            f"cannot write logs below {root}: {error.strerror}; SIMPLE_ROS_LOG_DIR names another place"
        ) from None
    return directory


def _made(root: Path, name: str) -> Path:
    number = 1
    while True:
        directory = root / (name if number == 1 else f"{name}-{number}")
        try:
            directory.mkdir()
        except FileExistsError:
            number += 1
        else:
            return directory


def _point(link: Path, target: Path) -> None:
    """Replace the link in one step, so that it always leads somewhere."""
    fresh = link.with_name(f".{link.name}-{os.getpid()}")
    fresh.unlink(missing_ok=True)
    fresh.symlink_to(target.name)
    fresh.replace(link)


class LogFile:
    """What a process said and what happened to it; made at the first line.

    Args:
        path: Where; it is continued if it is there.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file: TextIO | None = None
        self._is_broken = False

    def lines(self, lines: Sequence[str]) -> None:
        """Lines of its output. If they cannot be written, that is logged once, and they are lost."""
        if self._is_broken:
            return
        try:
            if self._file is None:
                self._file = self.path.open("a", encoding="utf-8")
            self._file.write("".join(f"{line}\n" for line in lines))
            self._file.flush()
        except OSError as error:
            # A full disk must not end the process that talks.
            self._is_broken = True
            logger.warning(
                "cannot write %s: %s; nothing more goes there", self.path, error.strerror
            )

    def note(self, text: str) -> None:
        """A line of the launcher's own, with the time."""
        stamp = time.strftime("%Y-%m-%d %H:%M:%S")
        self.lines([f"[launch {stamp}] {text}"])

    def close(self) -> None:
        """Nothing more will be written."""
        file, self._file = self._file, None
        if file is not None:
            # What could not be written is tried again, and has been told.
            with contextlib.suppress(OSError):
                file.close()
