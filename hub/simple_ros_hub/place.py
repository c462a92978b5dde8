"""Where a hub keeps what outlives it, and that only one is there."""

from __future__ import annotations

import fcntl
import json
import os
import re
from pathlib import Path
from typing import Any, Self

from simple_ros.errors import SimpleRosError

__all__ = ["HubRuns", "Place", "directory_for"]

_ROOT = "SIMPLE_ROS_RUN_DIR"
_BOOT = Path("/proc/sys/kernel/random/boot_id")


class HubRuns(SimpleRosError, RuntimeError):
    """A hub for this Master runs already.

    Attributes:
        directory: Its directory.
        pid: Its process; 0 if it does not say.
    """

    def __init__(self, directory: Path, pid: int) -> None:
        self.directory = directory
        self.pid = pid
        super().__init__(f"a hub runs already (pid {pid or 'unknown'}, {directory}); see --standby")


def directory_for(master: str) -> Path:
    """The directory of the hub for a Master, below ``SIMPLE_ROS_RUN_DIR`` or ``~/.simple_ros/run``."""
    said = os.environ.get(_ROOT, "")
    root = Path(said).expanduser() if said else Path.home() / ".simple_ros" / "run"
    return root.absolute() / f"hub-{re.sub('[^A-Za-z0-9.-]', '_', master)}"


class Place:
    """A hub's directory, locked while it lives; the lock goes with the process, however that ends.

    Args:
        directory: Where; it is made.

    Raises:
        HubRuns: Another hub has it.
        OSError: It cannot be made.
    """

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        directory.mkdir(parents=True, exist_ok=True)
        self._file = (directory / "hub.lock").open("a+", encoding="utf-8")
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self._file.seek(0)
            text = self._file.read().strip()
            self._file.close()
            raise HubRuns(directory, int(text) if text.isdigit() else 0) from None
        self._file.truncate(0)
        self._file.write(f"{os.getpid()}\n")
        self._file.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave it to others."""
        self._file.close()

    def remember(self, facts: dict[str, Any]) -> None:
        """Keep facts for the next hub, all or nothing."""
        fresh = self.directory / ".state.json"
        fresh.write_text(json.dumps({**facts, "boot": _boot()}), encoding="utf-8")
        fresh.replace(self.directory / "state.json")

    def remembered(self) -> dict[str, Any]:
        """What an earlier hub kept; nothing if there was none or it cannot be read.

        What it says of processes (``hub``, ``pids``) is left out if the computer was started since.
        """
        try:
            facts = json.loads((self.directory / "state.json").read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}
        if not isinstance(facts, dict):
            return {}
        if facts.pop("boot", "") != _boot():
            facts = {key: value for key, value in facts.items() if key not in ("hub", "pids")}
        return facts


def _boot() -> str:
    """Of this run of the computer."""
    return _BOOT.read_text(encoding="ascii").strip()
