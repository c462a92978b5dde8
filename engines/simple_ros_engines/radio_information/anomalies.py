"""Sudden changes: pure.

The newest value against the median of those before it. A change counts if it is over the threshold of
its kind and over five times the usual spread (median absolute deviation), so that a lively link is not
always abnormal. An anomaly ends when the value has come back half the way, or when the change has lasted
so long that it is the new normal.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import Enum
from statistics import median

from simple_ros_engines.radio_information.record import LinkRecord

__all__ = ["Anomaly", "AnomalyKind", "AnomalyWatch", "SuddenChange"]


class AnomalyKind(Enum):
    """What is abnormal."""

    SNR_DROP = "SNR_DROP"
    BLER_SPIKE = "BLER_SPIKE"
    LATENCY_SPIKE = "LATENCY_SPIKE"


@dataclass(frozen=True, slots=True)
class Anomaly:
    """A change that began or ended.

    Attributes:
        kind: What changed.
        began: Whether it began; else it ended.
        value: The newest value.
        usual: What it was before.
    """

    kind: AnomalyKind
    began: bool
    value: float
    usual: float


THRESHOLDS = {
    AnomalyKind.SNR_DROP: 5.0,
    AnomalyKind.BLER_SPIKE: 0.15,
    AnomalyKind.LATENCY_SPIKE: 30.0,
}
"""Smallest change that counts: dB, share, ms."""


_CONFIRM = {
    AnomalyKind.SNR_DROP: 2,
    AnomalyKind.BLER_SPIKE: 3,
    AnomalyKind.LATENCY_SPIKE: 2,
}
"""Samples in a row that make a change: a single bad one is noise. Adaptation takes two to follow a fade."""

_WINDOW = {
    AnomalyKind.SNR_DROP: 10,
    AnomalyKind.BLER_SPIKE: 20,
    AnomalyKind.LATENCY_SPIKE: 20,
}
"""Samples that say what is usual. A walk around a corner changes the ratio within two seconds."""


class SuddenChange:
    """Watches one number for changes in one direction.

    Args:
        threshold: Smallest change that counts.
        falls: Whether a fall is abnormal; else a rise is.
        window: Samples that say what is usual.
        least: Samples needed before anything is abnormal.
        spreads: How many spreads a change must exceed.
        lasting: Samples after which a change is the new normal.
        confirm: Samples in a row that make a change.
    """

    def __init__(
        self,
        threshold: float,
        *,
        falls: bool = False,
        window: int = 20,
        least: int = 5,
        spreads: float = 5.0,
        lasting: int = 50,
        confirm: int = 1,
    ) -> None:
        self.is_abnormal = False
        self.usual = 0.0
        self._sign = -1.0 if falls else 1.0
        self._threshold = threshold
        self._least = least
        self._spreads = spreads
        self._lasting = lasting
        self._confirm = confirm
        self._before: deque[float] = deque(maxlen=window)
        self._since: list[float] = []

    def sample(self, value: float) -> bool | None:
        """Take a value. True: a change began. False: it ended. None: nothing new."""
        if self.is_abnormal:
            return self._inside(value)
        if len(self._before) >= self._least:
            self.usual = median(self._before)
            spread = 1.4826 * median(abs(v - self.usual) for v in self._before)
            bar = max(self._threshold, self._spreads * spread)
            if self._sign * (value - self.usual) > bar:
                return self._suspected(value)
        # What looked like the beginning of a change was none.
        self._before.extend(self._since)
        self._since.clear()
        self._before.append(value)
        return None

    def _suspected(self, value: float) -> bool | None:
        self._since.append(value)
        self.is_abnormal = len(self._since) >= self._confirm
        return True if self.is_abnormal else None

    def _inside(self, value: float) -> bool | None:
        self._since.append(value)
        if len(self._since) >= self._lasting:
            self._before.clear()
            self._before.extend(self._since[-self._least :])
        elif self._sign * (value - self.usual) > self._threshold / 2:
            return None
        self.is_abnormal = False
        self._since.clear()
        return False


class AnomalyWatch:
    """Watches one link.

    Args:
        thresholds: Smallest change that counts, by kind.
    """

    def __init__(self, thresholds: dict[AnomalyKind, float] | None = None) -> None:
        chosen = {**THRESHOLDS, **(thresholds or {})}
        self._watches = {
            kind: SuddenChange(
                chosen[kind],
                falls=kind is AnomalyKind.SNR_DROP,
                window=_WINDOW[kind],
                confirm=_CONFIRM[kind],
            )
            for kind in AnomalyKind
        }

    def sample(self, record: LinkRecord) -> list[Anomaly]:
        """Take a record; tells what began and what ended."""
        side = record.side()
        values = {
            AnomalyKind.SNR_DROP: side.snr_db,
            AnomalyKind.BLER_SPIKE: side.bler,
            AnomalyKind.LATENCY_SPIKE: record.get("rtt_ms"),
        }
        found = []
        for kind, value in values.items():
            if value is None:
                continue
            watch = self._watches[kind]
            change = watch.sample(value)
            if change is not None:
                found.append(Anomaly(kind, change, value, watch.usual))
        return found

    def present(self) -> tuple[str, ...]:
        """Kinds that are abnormal now."""
        return tuple(kind.value for kind, watch in self._watches.items() if watch.is_abnormal)
