"""What happened: events and errors, each once, the newest thousand. Pure."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

__all__ = ["CALM_S", "Entry", "Journal"]

CALM_S = 5.0


@dataclass(frozen=True, slots=True)
class Entry:
    """Something happened.

    Attributes:
        number: Counts up over events and errors.
        stamp_ns: When, since 1970.
        component: Whom it is about; empty for the hub.
        text: What.
        is_error: Whether that is bad.
    """

    number: int
    stamp_ns: int
    component: str
    text: str
    is_error: bool


class Journal:
    """Keeps entries.

    Args:
        keep: How many events, and how many errors.
        before: What an earlier hub logged; numbers go on from there.

    Attributes:
        system_events: All of them.
        error_logs: The bad ones.
    """

    def __init__(self, keep: int = 1000, before: Iterable[Entry] = ()) -> None:
        self.system_events: deque[Entry] = deque(before, maxlen=keep)
        errors = (entry for entry in self.system_events if entry.is_error)
        self.error_logs: deque[Entry] = deque(errors, maxlen=keep)
        self._number = max((entry.number for entry in self.system_events), default=0)
        self._present: dict[str, int | None] = {}
        self._fresh: deque[Entry] = deque(maxlen=keep)

    def log_system_event(self, text: str, stamp_ns: int, component: str = "") -> Entry:
        """Something happened."""
        return self._add(text, stamp_ns, component, is_error=False)

    def log_error(self, text: str, stamp_ns: int, component: str = "") -> Entry:
        """Something bad happened."""
        return self._add(text, stamp_ns, component, is_error=True)

    def condition(
        self, key: str, text: str, stamp_ns: int, *, over: str = "", calm_s: float = CALM_S
    ) -> Entry | None:
        """Something bad is so, or is not any more; only that it begins and that it ended is logged.

        It has ended once it was not so for ``calm_s``: what comes and goes is one event.

        Args:
            key: What it is about.
            text: What is so; empty if it is not so now.
            stamp_ns: When it was looked at.
            over: What to say when it is over; empty for nothing.
            calm_s: See above.
        """
        if text:
            is_new = key not in self._present
            self._present[key] = None
            return self._add(text, stamp_ns, "", is_error=True) if is_new else None
        if key not in self._present:
            return None
        since_ns = self._present[key]
        if since_ns is None:
            since_ns = self._present[key] = stamp_ns
        if stamp_ns - since_ns < calm_s * 1e9:
            return None
        del self._present[key]
        return self._add(over, stamp_ns, "", is_error=False) if over else None

    def go_on(self, present: Iterable[str]) -> None:
        """Conditions that an earlier hub has told of; they are over when they are seen not to be so."""
        self._present.update(dict.fromkeys(present))

    @property
    def present(self) -> tuple[str, ...]:
        """Keys of what is so, or was a moment ago."""
        return tuple(self._present)

    def take_fresh(self) -> list[Entry]:
        """What came since the last call."""
        fresh = list(self._fresh)
        self._fresh.clear()
        return fresh

    def _add(self, text: str, stamp_ns: int, component: str, *, is_error: bool) -> Entry:
        self._number += 1
        entry = Entry(self._number, stamp_ns, component, text, is_error)
        self.system_events.append(entry)
        if is_error:
            self.error_logs.append(entry)
        self._fresh.append(entry)
        return entry
