"""What was, by link: sessions and windows of samples. Pure.

A gNB gives the RNTI of a device that left to another one. A link that was silent for longer than
`SessionBook.gap_s`, or whose counters fall, is therefore a new session, with windows of its own; the old
session is kept, marked inactive. So is one whose clock was set, since its samples no longer follow those
before.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import Enum

from simple_ros_engines.radio_information.record import LinkRecord
from simple_ros_engines.radio_information.series import Filling, Series

__all__ = ["Beginning", "Filling", "Series", "Session", "SessionBook"]

_COUNTERS = ("dl_bytes_total", "ul_bytes_total", "dl_rbs_total", "ul_rbs_total")
_JUMP_S = 2.0
_LATE_IN_A_ROW = 5
_LATE_FOR_S = 1.0


class Beginning(Enum):
    """Why a session began."""

    FIRST = "new link"
    SILENCE = "after silence"
    COUNTERS = "its counters began anew"
    CLOCK = "the clock of its source was set"


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
        beginning: Why it began.
        missing: Fields that the record before had and the newest has not.
        late_since_s: When the present row of late records began, by the steady clock.
        late_count: How many there are, each later than the one before.
        late_s: Time of the newest of them.
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
    beginning: Beginning = Beginning.FIRST
    missing: tuple[str, ...] = ()
    late_since_s: float = 0.0
    late_count: int = 0
    late_s: float = 0.0

    def of(self, name: str) -> Series:
        """The series of a field; empty if it never came."""
        found = self.series.get(name)
        if found is None:
            found = self.series[name] = Series(self.window)
        return found

    def add(
        self,
        record: LinkRecord,
        time_s: float,
        fields: Iterable[str],
        filling: Filling | None = None,
    ) -> None:
        """Take a record."""
        self.missing = tuple(name for name in self.newest.quality if name not in record.quality)
        self.late_count = 0
        self.last_seen_s = time_s
        self.newest = record
        self.is_active = True
        self.records.append(record)
        if len(self.records) > self.window:
            self.records.popleft()
        for name in fields:
            value = record.values.get(name)
            if value is not None:
                self.of(name).append(time_s, value, filling)

    def late(self, time_s: float, heard_s: float) -> bool:
        """A record came that is not later than the newest; whether they all do, since the clock was set."""
        self.stale += 1
        if not self.late_count or time_s <= self.late_s:
            self.late_count, self.late_since_s = 0, heard_s
        self.late_count += 1
        self.late_s = time_s
        return self.late_count >= _LATE_IN_A_ROW and heard_s - self.late_since_s >= _LATE_FOR_S

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
        filling: Which gaps in series are filled; None: none.
        live: Whether records come as fast as they were measured; else nothing follows from stamps that
            run ahead of the steady clock.
    """

    FIELDS = (
        "ul_snr_db", "dl_sinr_db", "ul_bler", "dl_bler", "dl_thr_bps", "ul_thr_bps",
        "rtt_ms", "buffer_bytes", "rsrp_dbm", "prb_used", "delivery_bps",
    )  # fmt: skip
    """Fields that have a series."""

    def __init__(
        self,
        window: int = 50,
        gap_s: float = 60.0,
        kept: int = 100,
        filling: Filling | None = None,
        live: bool = True,
    ) -> None:
        self.current: dict[str, Session] = {}
        self.ended: deque[Session] = deque(maxlen=kept)
        self._window = window
        self._gap_s = gap_s
        self._filling = filling
        self._live = live

    def take(self, record: LinkRecord, heard_s: float) -> tuple[Session, bool]:
        """File a record.

        Args:
            record: The record.
            heard_s: When it came, by a clock that never jumps.

        Returns:
            Its session, and whether that has just begun. A record that is not later than the newest of
            its session is counted in `Session.stale` and not filed, unless the clock of the source was
            set, which begins a session.
        """
        time_s = record.stamp_ns / 1e9
        session = self.current.get(record.link_id)
        if session is None:
            return self._begin(record, time_s, heard_s, 1, Beginning.FIRST), True
        why = self._ends(session, record, time_s, heard_s)
        if why is not None:
            session.is_active = False
            self.ended.append(session)
            return self._begin(record, time_s, heard_s, session.number + 1, why), True
        if time_s > session.last_seen_s:
            session.heard_s = heard_s
            session.add(record, time_s, self.FIELDS, self._filling)
        return session, False

    def _ends(
        self, session: Session, record: LinkRecord, time_s: float, heard_s: float
    ) -> Beginning | None:
        """Why a record is no part of its link's session; None if it is."""
        ahead_s = time_s - session.last_seen_s
        if -self._gap_s <= ahead_s <= 0:
            return Beginning.CLOCK if session.late(time_s, heard_s) else None
        jumped = self._live and ahead_s - (heard_s - session.heard_s) > _JUMP_S
        if ahead_s < 0 or jumped:
            return Beginning.CLOCK
        if ahead_s > self._gap_s:
            return Beginning.SILENCE
        return Beginning.COUNTERS if _restarted(session.newest, record) else None

    def _begin(
        self, record: LinkRecord, time_s: float, heard_s: float, number: int, why: Beginning
    ) -> Session:
        session = Session(
            record.link_id, number, time_s, time_s, heard_s, record, self._window, beginning=why
        )
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

    def forget(self, now_s: float, after_s: float) -> list[str]:
        """Forget links of which nothing came for so long; gives their keys."""
        gone = [link for link, session in self.current.items() if now_s - session.heard_s > after_s]
        for link in gone:
            del self.current[link]
        return gone

    def active(self) -> list[Session]:
        """Links of which records come."""
        return [session for session in self.current.values() if session.is_active]


def _restarted(before: LinkRecord, now: LinkRecord) -> bool:
    return any(
        before.values.get(name, 0.0) > now.values.get(name, float("inf")) for name in _COUNTERS
    )
