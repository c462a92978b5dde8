"""When an interface is asked again: pure."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime

__all__ = ["RetryPolicy", "retry_after_s"]

_AGAIN = frozenset({408, 425, 429, 500, 502, 503, 504})
_LONGEST_S = 3600.0


@dataclass(frozen=True, slots=True)
class RetryPolicy:
    """How often, and how long in between.

    Attributes:
        attempts: In all, the first among them.
        first_s: Before the second; doubled each time.
        longest_s: What is longer than this is left to the caller.
    """

    attempts: int = 3
    first_s: float = 0.2
    longest_s: float = 5.0

    def delay_s(self, attempt: int, status: int | None, wished_s: float | None) -> float | None:
        """How long to wait before the next attempt; None to give up.

        Args:
            attempt: Those made, 1 and more.
            status: Of the answer; None without one.
            wished_s: What the server asked for.
        """
        if attempt >= self.attempts or (status is not None and status not in _AGAIN):
            return None
        delay_s = self.first_s * 2 ** (attempt - 1) if wished_s is None else wished_s
        return delay_s if delay_s <= self.longest_s else None


def retry_after_s(header: str | None, now: datetime) -> float | None:
    """Seconds of a ``Retry-After`` header, which has a number or a date; None if it makes no sense."""
    if not header:
        return None
    if header.strip().isdigit():
        return min(_LONGEST_S, float(header))
    try:
        when = parsedate_to_datetime(header)
    except ValueError:
        return None
    if when.tzinfo is None:
        when = when.replace(tzinfo=UTC)
    return min(_LONGEST_S, max(0.0, (when - now).total_seconds()))
