"""What the bridge does to sensor data: from constraints and strategies, without fluttering. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = ["FlowBudget", "Reluctant", "Treatment", "TreatmentJudge"]

UNTOUCHED_RATIO = 0.98


class Reluctant:
    """A number that falls at once and rises only after more was wanted for a while.

    Args:
        value: At first.
        dwell_s: How long; then it rises to the least that was wanted meanwhile.
    """

    def __init__(self, value: float, dwell_s: float) -> None:
        self.value = value
        self._dwell_s = dwell_s
        self._since_s: float | None = None
        self._least = value

    def want(self, value: float, now_s: float) -> float:
        """This is wanted now; the number now."""
        if value <= self.value:
            self.value, self._since_s = value, None
        elif self._since_s is None:
            self._since_s, self._least = now_s, value
        else:
            self._least = min(self._least, value)
            if now_s - self._since_s >= self._dwell_s:
                self.value, self._since_s = self._least, None
        return self.value


@dataclass(frozen=True, slots=True)
class Treatment:
    """What is done.

    Attributes:
        scale: Per cent of each side of a picture.
        rate_hz: Messages a second; infinite: all.
        ratio: Bytes out per byte in to aim at, by quality and voxels.
    """

    scale: float = 100.0
    rate_hz: float = math.inf
    ratio: float = 1.0

    @property
    def is_untouched(self) -> bool:
        """Whether bytes are handed on as they came."""
        return self.scale >= 100 and self.ratio >= UNTOUCHED_RATIO


class TreatmentJudge:
    """Decides for one link.

    Args:
        dwell_s: How long the link must have been better before more is sent.
    """

    def __init__(self, dwell_s: float = 2.0) -> None:
        self._scale = Reluctant(100.0, dwell_s)
        self._rate = Reluctant(math.inf, dwell_s)
        self._ratio = Reluctant(1.0, dwell_s)

    @property
    def treatment(self) -> Treatment:
        """Now."""
        return Treatment(self._scale.value, self._rate.value, self._ratio.value)

    def constraint(self, scale: float, rate_hz: float, now_s: float) -> Treatment:
        """A constraint came; ``rate_hz`` counts while the scale is below 100, and 0 is no limit."""
        healthy = scale >= 100
        self._scale.want(min(100.0, scale or 100.0), now_s)
        self._rate.want(math.inf if healthy or rate_hz <= 0 else rate_hz, now_s)
        return self.treatment

    def strategy(self, ratio: float, now_s: float) -> Treatment:
        """A strategy came; a ratio of 0 says nothing."""
        self._ratio.want(min(1.0, max(0.05, ratio or 1.0)), now_s)
        return self.treatment


class FlowBudget:
    """What one topic may send: bits a second, and what that means for its messages.

    Attributes:
        rate_bps: What it may send; infinite until it is told.
    """

    def __init__(self) -> None:
        self.rate_bps = math.inf
        self._mean_bytes = 0.0
        self._period_s = 0.0
        self._last_s: float | None = None

    def came(self, now_s: float) -> None:
        """A message came in."""
        if self._last_s is not None:
            period_s = min(10.0, now_s - self._last_s)
            self._period_s += 0.2 * (period_s - self._period_s) if self._period_s else period_s
        self._last_s = now_s

    def sent(self, size_bytes: int) -> None:
        """A message went out."""
        self._mean_bytes += (
            0.2 * (size_bytes - self._mean_bytes) if self._mean_bytes else size_bytes
        )

    def rate_hz(self, wanted_hz: float) -> float:
        """How many messages a second fit, at most ``wanted_hz``; at least one a second is tried."""
        if math.isinf(self.rate_bps) or not self._mean_bytes:
            return wanted_hz
        return min(wanted_hz, max(1.0, self.rate_bps / (8 * self._mean_bytes)))

    def message_bytes(self, wanted_hz: float) -> float:
        """What a message may take if they keep coming as they do, at most ``wanted_hz`` of them."""
        if math.isinf(self.rate_bps):
            return math.inf
        coming_hz = 1 / self._period_s if self._period_s else 10.0
        return self.rate_bps / 8 / max(0.1, min(wanted_hz, coming_hz))
