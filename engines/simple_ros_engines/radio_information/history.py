"""What was, by link: sessions and windows of samples. Pure.

A gNB gives the RNTI of a device that left to another one. A link that was silent for longer than
`SessionBook.gap_s`, or whose counters fall, is therefore a new session, with windows of its own; the old
session is kept, marked inactive.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field

from simple_ros_engines.radio_information.record import LinkRecord

__all__ = ["Series", "Session", "SessionBook"]

_COUNTERS = ("dl_bytes_total", "ul_bytes_total", "dl_rbs_total", "ul_rbs_total")


class Series:
    """The newest samples of one number, with their times.

    Args:
        size: How many are kept.
    """

    __slots__ = ("times_s", "values")

    def __init__(self, size: int) -> None:
        self.times_s: deque[float] = deque(maxlen=size)
        self.values: deque[float] = deque(maxlen=size)

    def append(self, time_s: float, value: float) -> None:
        """Add a sample; one that is not later than the newest replaces nothing and is left out."""
        if not self.times_s or time_s > self.times_s[-1]:
            self.times_s.append(time_s)
            self.values.append(value)

    def last(self, count: int) -> list[float]:
        """The newest values, oldest first."""
        values = self.values
        return list(values)[-count:] if count < len(values) else list(values)

    def __len__(self) -> int:
        return len(self.values)


@dataclass(slots=True)
class Session:
    """One device on one link.

    Attributes:
        link_id: Key of the link.
        number: Counts the sessions of the link, from 1.
        first_seen_s: Time of its first record.
        last_seen_s: Time of its newest.
        heard_s: When that came, by this computer's steady clock.
        newest: Its newest record.
        window: How many samples its series keep.
        records: The newest records.
        series: By field name.
        is_active: Whether records still come.
        stale: Records that were not later than the newest and left out.
    """

    link_id: str
    number: int
    first_seen_s: float
    last_seen_s: float
    heard_s: float
    newest: LinkRecord
    window: int = 50
    records: deque[LinkRecord] = field(default_factory=deque)
    series: dict[str, Series] = field(default_factory=dict)
    is_active: bool = True
    stale: int = 0

    def of(self, name: str) -> Series:
        """The series of a field; empty if it never came."""
        found = self.series.get(name)
        if found is None:
            found = self.series[name] = Series(self.window)
        return found

    def add(self, record: LinkRecord, time_s: float, fields: Iterable[str]) -> None:
        """Take a record."""
        self.last_seen_s = time_s
        self.newest = record
        self.is_active = True
        self.records.append(record)
        if len(self.records) > self.window:
            self.records.popleft()
        for name in fields:
            value = record.values.get(name)
            if value is not None:
                self.of(name).append(time_s, value)

    def delta(self, name: str) -> tuple[float, float] | None:
        """By how much a counter rose between the last two records, and in which time, s."""
        if len(self.records) < 2:
            return None
        before, now = self.records[-2], self.records[-1]
        old, new = before.get(name), now.get(name)
        span_s = (now.stamp_ns - before.stamp_ns) / 1e9
        if old is None or new is None or span_s <= 0 or new < old:
            return None
        return new - old, span_s


class SessionBook:
    """The sessions of all links.

    Args:
        window: Samples kept for each series.
        gap_s: Silence that ends a session.
        kept: Ended sessions remembered, all links together.
    """

    FIELDS = (
        "ul_snr_db", "dl_sinr_db", "ul_bler", "dl_bler", "dl_thr_bps", "ul_thr_bps",
        "rtt_ms", "buffer_bytes", "rsrp_dbm", "prb_used", "delivery_bps",
    )  # fmt: skip

    def __init__(self, window: int = 50, gap_s: float = 60.0, kept: int = 100) -> None:
        self.current: dict[str, Session] = {}
        self.ended: deque[Session] = deque(maxlen=kept)
        self._window = window
        self._gap_s = gap_s

    def take(self, record: LinkRecord, heard_s: float) -> tuple[Session, bool]:
        """File a record.

        Args:
            record: The record.
            heard_s: When it came, by a clock that never jumps.

        Returns:
            Its session, and whether that has just begun. A record that is not later than the newest of
            its session is counted in `Session.stale` and not filed, unless the clock was set back by
            more than the gap, which begins a session.
        """
        time_s = record.stamp_ns / 1e9
        session = self.current.get(record.link_id)
        if session is None:
            return self._begin(record, time_s, heard_s, 1), True
        behind_s = session.last_seen_s - time_s
        if 0 <= behind_s <= self._gap_s:
            session.stale += 1
            return session, False
        if abs(behind_s) > self._gap_s or _restarted(session.newest, record):
            session.is_active = False
            self.ended.append(session)
            return self._begin(record, time_s, heard_s, session.number + 1), True
        session.heard_s = heard_s
        session.add(record, time_s, self.FIELDS)
        return session, False

    def _begin(self, record: LinkRecord, time_s: float, heard_s: float, number: int) -> Session:
        session = Session(record.link_id, number, time_s, time_s, heard_s, record, self._window)
        session.add(record, time_s, self.FIELDS)
        self.current[record.link_id] = session
        return session

    def mark_inactive(self, now_s: float, after_s: float) -> list[Session]:
        """Mark links of which nothing came for ``after_s``; gives those newly marked. They are kept."""
        silent = [
            session
            for session in self.current.values()
            if session.is_active and now_s - session.heard_s > after_s
        ]
        for session in silent:
            session.is_active = False
        return silent

    def active(self) -> list[Session]:
        """Links of which records come."""
        return [session for session in self.current.values() if session.is_active]


def _restarted(before: LinkRecord, now: LinkRecord) -> bool:
    return any(
        before.values.get(name, 0.0) > now.values.get(name, float("inf")) for name in _COUNTERS
    )
