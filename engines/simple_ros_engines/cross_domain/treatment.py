"""What the bridge does to sensor data: from constraints and strategies, without fluttering. Pure."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["FlowBudget", "Reluctant", "Treatment", "TreatmentJudge", "fair_rates"]

UNTOUCHED_RATIO = 0.98
_PATIENCE_S = 0.25
"""How long a link may carry less than before until messages are left out."""


class Reluctant:
    """A number that falls at once and rises only to the least that was wanted for a while.

    Args:
        value: At first.
        dwell_s: How long.
    """

    def __init__(self, value: float, dwell_s: float) -> None:
        self.value = value
        self._dwell_s = dwell_s
        self._wanted = value
        # What was wanted and until when, rising: what a later and lesser wish outlives does not matter.
        self._past: deque[tuple[float, float]] = deque()

    def want(self, value: float, now_s: float) -> float:
        """This is wanted now; the number now."""
        past = self._past
        while past and past[-1][0] >= self._wanted:
            past.pop()
        past.append((self._wanted, now_s))
        while past and now_s - past[0][1] >= self._dwell_s:
            past.popleft()
        self._wanted = value
        self.value = min(value, past[0][0]) if past else value
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


def fair_rates(total_bps: float, wanted_bps: Sequence[float]) -> list[float]:
    """What is there, divided evenly; what one does not want goes to the others."""
    given = [0.0] * len(wanted_bps)
    rest_bps = total_bps
    order = sorted(range(len(wanted_bps)), key=lambda index: wanted_bps[index])
    for place, index in enumerate(order):
        given[index] = min(wanted_bps[index], rest_bps / (len(order) - place))
        rest_bps -= given[index]
    return given


class FlowBudget:
    """What one topic may send: bits a second, and what that means for its messages.

    Attributes:
        rate_bps: What it may send; infinite until it is told.
    """

    def __init__(self) -> None:
        self.rate_bps = math.inf
        self._patient_bps = math.inf
        self._mean_bytes = 0.0
        self._period_s = 0.0
        self._last_s: float | None = None

    def came(self, now_s: float) -> None:
        """A message came in."""
        if self._last_s is not None:
            period_s = min(10.0, now_s - self._last_s)
            self._period_s += 0.2 * (period_s - self._period_s) if self._period_s else period_s
            self._wait_out(period_s)
        self._last_s = now_s

    def _wait_out(self, period_s: float) -> None:
        """A fade that ends soon shall cost size only: what waits through it is not yet too late."""
        if self.rate_bps >= self._patient_bps or math.isinf(self._patient_bps):
            self._patient_bps = self.rate_bps
        else:
            kept = math.exp(-period_s / _PATIENCE_S)
            self._patient_bps = self.rate_bps + kept * (self._patient_bps - self.rate_bps)

    def sent(self, size_bytes: int) -> None:
        """A message went out."""
        self._mean_bytes += (
            0.2 * (size_bytes - self._mean_bytes) if self._mean_bytes else size_bytes
        )

    @property
    def coming_hz(self) -> float:
        """How many messages a second come; 0 before the second."""
        return 1 / self._period_s if self._period_s else 0.0

    def limit_hz(self, constraint_hz: float) -> float:
        """What of a constraint's frame rate holds: it stands in for a budget, and where that is told, bytes count."""
        return constraint_hz if math.isinf(self.rate_bps) else math.inf

    def rate_hz(self, wanted_hz: float, message_bytes: float | None = None) -> float:
        """How many messages a second fit, at most ``wanted_hz``; at least one a second is tried.

        Args:
            wanted_hz: Never more. It is the answer, too, if all that come fit.
            message_bytes: What the next will take; None: the mean of those that went out.
        """
        size = message_bytes or self._mean_bytes
        if math.isinf(self.rate_bps) or not size:
            return wanted_hz
        patient_bps = self.rate_bps if math.isinf(self._patient_bps) else self._patient_bps
        fits_hz = max(self.rate_bps, patient_bps) / (8 * size)
        if 0 < 0.99 * self.coming_hz <= fits_hz:
            return wanted_hz
        return min(wanted_hz, max(1.0, fits_hz))

    def message_bytes(self, wanted_hz: float = math.inf) -> float:
        """What a message may take if they keep coming as they do, at most ``wanted_hz`` of them."""
        if math.isinf(self.rate_bps):
            return math.inf
        return self.rate_bps / 8 / max(0.1, min(wanted_hz, self.coming_hz or 10.0))
