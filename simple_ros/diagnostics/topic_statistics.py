"""How a topic flows: rate, bandwidth, age, losses. Pure; times are in seconds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from simple_ros.diagnostics.status import ERROR, OK, WARN, Status

__all__ = ["TopicFacts", "TopicStatistics"]

# Back by more than this is a publisher that began anew, not a message that came late.
_REORDER = 100


@dataclass(frozen=True, slots=True)
class TopicFacts:
    """What flowed between two looks, and counters since the first.

    Attributes:
        period_s: Between the looks.
        messages: That flowed in the period.
        rate_hz: Messages a second.
        bandwidth_bps: Bytes a second.
        mean_age_s: Mean of now minus stamp; None without stamps.
        max_age_s: The largest of them; None without stamps.
        gaps: Messages missing in ``header.seq``, in all.
        duplicates: Messages whose ``header.seq`` came twice in a row, in all.
        late: Messages that came after one with a higher ``header.seq``, in all.
        dropped: Messages given up by a queue in the period.
        dropped_in_all: Such messages since the first look.
        waiting: Messages that wait now.
    """

    period_s: float
    messages: int
    rate_hz: float
    bandwidth_bps: float
    mean_age_s: float | None
    max_age_s: float | None
    gaps: int
    duplicates: int
    late: int
    dropped: int
    dropped_in_all: int
    waiting: int


class TopicStatistics:
    """Counts what flows on a topic, for one publisher or subscription.

    ``header.seq`` counts up for each publisher, so gaps and duplicates only mean something while one
    publishes; with several, pass ``several`` and they are not counted.

    Args:
        now_s: When counting begins.
    """

    def __init__(self, now_s: float) -> None:
        self._since_s = now_s
        self._messages = 0
        self._bytes = 0
        self._aged = 0
        self._age_sum_s = 0.0
        self._age_max_s = -math.inf
        self._seq: int | None = None
        self._gaps = 0
        self._duplicates = 0
        self._late = 0
        self._dropped_before = 0

    def message(
        self,
        size_bytes: int,
        now_s: float,
        *,
        stamp_s: float = 0.0,
        seq: int | None = None,
        several: bool = False,
    ) -> None:
        """A message flowed.

        Args:
            size_bytes: Its size.
            now_s: When, on the clock of the stamps.
            stamp_s: Its stamp; 0 if it has none.
            seq: Its ``header.seq``; None or 0 if it has none.
            several: Whether it may come from one of several publishers.
        """
        self._messages += 1
        self._bytes += size_bytes
        if stamp_s:
            age_s = now_s - stamp_s
            self._aged += 1
            self._age_sum_s += age_s
            self._age_max_s = max(self._age_max_s, age_s)
        if several:
            self._seq = None
        elif seq:
            self._count(seq)

    def _count(self, seq: int) -> None:
        last = self._seq
        if last is None or seq < last - _REORDER:
            self._seq = seq
        elif seq == last:
            self._duplicates += 1
        elif seq < last:
            # It was counted as missing when the later one came.
            self._late += 1
            self._gaps -= 1 if self._gaps else 0
        else:
            self._gaps += seq - last - 1
            self._seq = seq

    def look(self, now_s: float, *, dropped: int = 0, waiting: int = 0) -> TopicFacts:
        """What flowed since the last look.

        Args:
            now_s: When.
            dropped: Counter of messages that a queue gave up.
            waiting: Messages that wait now.
        """
        period_s = now_s - self._since_s
        share = 1.0 / period_s if period_s > 0 else 0.0
        facts = TopicFacts(
            period_s,
            self._messages,
            self._messages * share,
            self._bytes * share,
            self._age_sum_s / self._aged if self._aged else None,
            self._age_max_s if self._aged else None,
            self._gaps,
            self._duplicates,
            self._late,
            max(0, dropped - self._dropped_before),
            dropped,
            waiting,
        )
        self._since_s = now_s
        self._messages = self._bytes = self._aged = 0
        self._age_sum_s, self._age_max_s = 0.0, -math.inf
        self._dropped_before = dropped
        return facts


def write(facts: TopicFacts, status: Status, *, needs_messages: bool) -> None:
    """Write facts into a status: dropping is a warning, silence an error if messages are needed."""
    if facts.messages:
        status.merge_summary(OK, f"{facts.rate_hz:.2f} Hz")
    else:
        status.merge_summary(ERROR if needs_messages else OK, "nothing flows")
    if facts.dropped:
        status.merge_summary(WARN, f"{facts.dropped} messages were dropped")
    for key, value in _values(facts).items():
        if value is not None:
            status.add(key, value)


def _values(facts: TopicFacts) -> dict[str, Any]:
    return {
        "messages": facts.messages,
        "rate (Hz)": facts.rate_hz,
        "bandwidth (B/s)": facts.bandwidth_bps,
        "mean age (s)": facts.mean_age_s,
        "largest age (s)": facts.max_age_s,
        "gaps": facts.gaps,
        "duplicates": facts.duplicates,
        "late": facts.late,
        "dropped": facts.dropped_in_all,
        "waiting": facts.waiting,
    }
