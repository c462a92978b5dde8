"""What happened, told to everybody once: journal, file, topic, log."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable

from simple_ros_hub.event_log import EventLog
from simple_ros_hub.journal import CALM_S, Entry, Journal

__all__ = ["Chronicle"]

logger = logging.getLogger(__name__)

_KEEP = 1000


class Chronicle:
    """Logs, and goes on where an earlier hub was killed.

    Args:
        log: Where entries outlive the hub.
        stamp_ns: The time to log with.

    Attributes:
        journal: What is known.
    """

    def __init__(self, log: EventLog, stamp_ns: Callable[[], int]) -> None:
        self.journal = Journal(_KEEP, log.read(_KEEP))
        self._log = log
        self._stamp_ns = stamp_ns

    def go_on(self, present: Iterable[str]) -> None:
        """Conditions that an earlier hub has told of: if they are so still, that is not told again."""
        self.journal.go_on(present)

    def log_event(self, text: str, component: str = "") -> None:
        """Something happened."""
        self._keep(self.journal.log_system_event(text, self._stamp_ns(), component))

    def log_error(self, text: str, component: str = "") -> None:
        """Something bad happened."""
        self._keep(self.journal.log_error(text, self._stamp_ns(), component))

    def condition(self, key: str, text: str, over: str, calm_s: float = CALM_S) -> None:
        """Something bad is so, or is not any more (see `Journal.condition`)."""
        entry = self.journal.condition(key, text, self._stamp_ns(), over=over, calm_s=calm_s)
        if entry is not None:
            self._keep(entry)

    def take_unsent(self) -> list[Entry]:
        """What the topic has not had yet."""
        return self.journal.take_fresh()

    def _keep(self, entry: Entry) -> None:
        self._log.append(entry)
        if entry.is_error:
            logger.error("%s", entry.text)
        else:
            logger.info("System Event: %s", entry.text)
