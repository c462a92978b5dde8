"""How a source of metrics is, from what comes of it: pure.

A source is degraded while it is down, silent, behind, or gives what no radio can have. Nothing of that stops
anything: good values are used, bad ones withheld, and `SourceHealth.verdict` says what is wrong.
"""

from __future__ import annotations

from collections import Counter, deque

from simple_ros_engines.radio_information.record import LinkRecord

__all__ = ["SourceHealth"]

_RECENT_S = 5.0
_WINDOW = 20


class SourceHealth:
    """Watches one source.

    Args:
        now_s: By a steady clock, as everywhere here.
        stale_after_s: Age from which records count as late.
        silent_after_s: Without any record for so long it counts as silent.
        live: Whether it tells of the present; else age means nothing.

    Attributes:
        counts: What was wrong since the start: ``withheld_values``, ``late_records``, ``future_records``,
            ``source_failures``.
        age_s: Age of the newest record when it came.
    """

    def __init__(
        self,
        now_s: float,
        stale_after_s: float = 2.0,
        silent_after_s: float = 2.0,
        *,
        live: bool = True,
    ) -> None:
        self.counts: Counter[str] = Counter(
            withheld_values=0, late_records=0, future_records=0, source_failures=0
        )
        self.age_s = 0.0
        self._stale_after_s = stale_after_s
        self._silent_after_s = silent_after_s
        self._live = live
        self._heard_s = now_s
        self._down = ""
        self._ages: deque[float] = deque(maxlen=_WINDOW)
        self._suspects: dict[str, tuple[str, float]] = {}

    def came(self, item: LinkRecord, wall_ns: int, now_s: float) -> float:
        """A record came.

        Args:
            item: The record.
            wall_ns: When, by the clock that records are stamped with.
            now_s: When, by the steady clock.

        Returns:
            Its age, s; 0 if the source does not tell of the present.
        """
        self._down = ""
        self._heard_s = now_s
        for name in item.suspects():
            self.counts["withheld_values"] += 1
            self._suspects[name] = (item.link_id, now_s)
        if not self._live:
            return 0.0
        self.age_s = (wall_ns - item.stamp_ns) / 1e9
        self._ages.append(self.age_s)
        self.counts["late_records"] += self.age_s > self._stale_after_s
        self.counts["future_records"] += self.age_s < -self._stale_after_s
        return self.age_s

    def failed(self, reason: str) -> None:
        """The source gives nothing at present."""
        self.counts["source_failures"] += 1
        self._down = reason

    def ended(self) -> None:
        """The source has given all it had."""
        self._down = "the source has ended"

    def verdict(self, now_s: float) -> str:
        """What is wrong; empty if nothing is."""
        return self._down or "; ".join(
            part for part in (self._silence(now_s), self._lag(), self._withheld(now_s)) if part
        )

    def _silence(self, now_s: float) -> str:
        silent_s = now_s - self._heard_s
        return f"nothing came for {silent_s:.0f} s" if silent_s > self._silent_after_s else ""

    def _lag(self) -> str:
        if not self._ages:
            return ""
        # One late record is no slow source.
        middle = sorted(self._ages)[len(self._ages) // 2]
        if middle > self._stale_after_s:
            return f"records are {middle:.1f} s old when they come"
        if middle < -self._stale_after_s:
            return f"records are stamped {-middle:.1f} s ahead: clocks differ"
        return ""

    def _withheld(self, now_s: float) -> str:
        recent = {
            name: link for name, (link, at_s) in self._suspects.items() if now_s - at_s <= _RECENT_S
        }
        if not recent:
            return ""
        names = ", ".join(f"{name} of {link}" for name, link in sorted(recent.items()))
        return f"withheld, since no radio can have it (a wrong unit?): {names}"
