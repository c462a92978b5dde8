"""More lost blocks than signal and scheme explain: pure.

Link adaptation holds the error rate at its target whatever the signal, so the correlation of the two says
nothing. What interference that the reported ratio does not contain does change is the ratio at which the
observed errors would be expected: `radio.bler.implied_snr_db`. Its distance to the reported ratio is a
constant of the radio, some dB, found as a slow median; adaptation lowers the scheme and the distance stays.
When the distance falls short of the usual one for long, that is interference: a one-sided cumulative sum
(Page, "Continuous inspection schemes", 1954) in units of the usual spread.
"""

from __future__ import annotations

from collections import deque
from statistics import median

from simple_ros_engines.radio.bler import implied_snr_db
from simple_ros_engines.radio.mcs import McsTable, mcs_entry, mcs_table
from simple_ros_engines.radio_information.record import LinkRecord

__all__ = ["InterferenceWatch"]


class InterferenceWatch:
    """Watches one link.

    Args:
        table: Which schemes the link has.
        learn: Samples that say what is usual.
        slack: Spreads that a sample may fall short for nothing.
        alarm: Sum of shortfalls, in spreads, that is an alarm.
        most: What one sample adds at most, so that no single one is an alarm.
        least_spread_db: The usual spread counts at least as this.
    """

    def __init__(
        self,
        table: McsTable = McsTable.QAM64,
        *,
        learn: int = 100,
        slack: float = 1.5,
        alarm: float = 12.0,
        most: float = 3.0,
        least_spread_db: float = 0.8,
    ) -> None:
        self.is_present = False
        self._table = table
        self._learn = learn
        self._slack = slack
        self._alarm = alarm
        self._most = most
        self._least_spread = least_spread_db
        self._usual: deque[float] = deque(maxlen=5 * learn)
        self._sum = 0.0
        self._middle = 0.0
        self._spread = least_spread_db
        self._count = 0

    def sample(self, record: LinkRecord) -> bool | None:
        """Take a record. True: interference began. False: it ended. None: nothing new."""
        side = record.side()
        if side.snr_db is None or side.bler is None or side.mcs is None:
            return None
        return self.take(side.snr_db, side.bler, side.mcs)

    def take(self, snr_db: float, bler: float, mcs: int) -> bool | None:
        """As `sample`, of plain numbers."""
        entries = mcs_table(self._table)
        entry = mcs_entry(self._table, min(mcs, len(entries) - 1))
        distance = implied_snr_db(entry, round(bler, 2)) - snr_db
        # At an end of the table adaptation stops, and few errors only say "better than".
        at_top = entry.index == len(entries) - 1 and bler < 0.1
        if at_top:
            return self._better_than_measured()
        if len(self._usual) < self._learn:
            self._usual.append(distance)
            return None
        self._refresh()
        shortfall = (self._middle - distance) / self._spread - self._slack
        self._sum = min(2 * self._alarm, max(0.0, self._sum + min(self._most, shortfall)))
        # What is under suspicion does not become usual.
        is_clean = self._sum <= 0 if self.is_present else self._sum < self._alarm / 2
        if is_clean:
            self._usual.append(distance)
        return self._judge()

    def _better_than_measured(self) -> bool | None:
        self._sum = max(0.0, self._sum - self._slack)
        return self._judge()

    def _judge(self) -> bool | None:
        if not self.is_present and self._sum >= self._alarm:
            self.is_present = True
            return True
        if self.is_present and self._sum <= 0.0:
            self.is_present = False
            return False
        return None

    def _refresh(self) -> None:
        if self._count % 20 == 0:
            self._middle = median(self._usual)
            spread = 1.4826 * median(abs(v - self._middle) for v in self._usual)
            self._spread = max(self._least_spread, spread)
        self._count += 1
