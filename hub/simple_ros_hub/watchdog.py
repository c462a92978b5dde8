"""Whether messages flow as they should: period, gaps, duplicates, silence. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from simple_ros.diagnostics.status import ERROR, OK, WARN, Level
from simple_ros.diagnostics.topic_statistics import TopicFacts, TopicStatistics

__all__ = ["Finding", "TopicWatchdog"]


@dataclass(frozen=True, slots=True)
class Finding:
    """How a topic is.

    Attributes:
        level: OK, WARN or ERROR.
        text: Why.
        facts: What flowed since the last look.
    """

    level: Level
    text: str
    facts: TopicFacts


class TopicWatchdog:
    """Watches one topic.

    Args:
        topic: For messages.
        period_s: Expected between messages; 0: none is expected, only gaps and duplicates count.
        now_s: When it begins.
        tolerance: Periods of silence after which it counts as silent.
        max_gap_share: Share of missing messages that is still well.
    """

    def __init__(
        self,
        topic: str,
        period_s: float,
        now_s: float,
        *,
        tolerance: float = 5.0,
        max_gap_share: float = 0.05,
    ) -> None:
        self.topic = topic
        self.period_s = period_s
        self.messages = 0
        self.gaps = 0
        self.duplicates = 0
        self._tolerance = tolerance
        self._max_gap_share = max_gap_share
        self._statistics = TopicStatistics(now_s)
        self._last_s: float | None = None
        self._is_anew = False
        self._stopped_s = now_s

    def message(self, size_bytes: int, now_s: float, seq: int | None, *, several: bool) -> None:
        """A message came.

        Args:
            size_bytes: Its size.
            now_s: When.
            seq: Its number, if it has one.
            several: Whether several publishers send on the topic.
        """
        self.messages += 1
        self._last_s = now_s
        # A number of 0 begins a count; so does what follows `begins_anew`.
        is_first = seq == 0 or self._is_anew
        self._is_anew = False
        self._statistics.message(size_bytes, now_s, seq=seq, several=several or is_first)

    def begins_anew(self) -> None:
        """Whoever sends was started again, and counts from the beginning."""
        self._is_anew = True

    def look(self, now_s: float, *, needed: bool = True) -> Finding:
        """How it is since the last look.

        Args:
            now_s: When.
            needed: Whether anybody ought to send now.
        """
        facts = self._statistics.look(now_s)
        gaps, duplicates = facts.gaps - self.gaps, facts.duplicates - self.duplicates
        self.gaps, self.duplicates = facts.gaps, facts.duplicates
        if not needed:
            self._stopped_s = now_s
            return Finding(OK, "nobody ought to send", facts)
        since_s = self._stopped_s if self._last_s is None else max(self._last_s, self._stopped_s)
        silent_s = now_s - since_s
        if self.period_s and silent_s > self._tolerance * self.period_s:
            return Finding(ERROR, f"{self.topic} is silent for {silent_s:.1f} s", facts)
        if gaps > self._max_gap_share * max(1, facts.messages + gaps):
            return Finding(WARN, f"{self.topic} lost {gaps} of {facts.messages + gaps}", facts)
        if duplicates:
            return Finding(WARN, f"{self.topic} came twice {duplicates} times", facts)
        is_slow = self.period_s and facts.period_s >= 4 * self.period_s and facts.messages
        if is_slow and facts.rate_hz < 0.5 / self.period_s:
            return Finding(WARN, f"{self.topic} comes at {facts.rate_hz:.1f} Hz only", facts)
        return Finding(OK, f"{facts.rate_hz:.1f} Hz", facts)
