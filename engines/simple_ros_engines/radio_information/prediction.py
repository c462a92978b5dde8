"""What a number will be in a moment: several simple forecasters, the ones that proved best speak. Pure.

Every forecaster issues a forecast with each sample; when its time has come it is scored by what really
came. The forecast that is given is the mean of all, weighted by how they did (Cesa-Bianchi and Lugosi,
"Prediction, Learning, and Games", 2006, ch. 2): smooth where noise rules, the newest value where the
number wanders, a line where it goes somewhere. Two more learn what the simple ones together miss, by linear
combination of the past of the number and of others beside it (`forecasting.LinearForecaster`). Confidence is one
minus the mean relative error.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from statistics import fmean

from simple_ros_engines.forecasting import LinearForecaster

__all__ = ["Forecast", "Predictor", "line_fit"]


@dataclass(frozen=True, slots=True)
class Forecast:
    """An expectation.

    Attributes:
        value: Expected, in the unit of the samples.
        horizon_s: How far ahead.
        confidence: 0..1, from how earlier forecasts came out; 0 before any did.
        error: Mean absolute error of earlier forecasts, in the unit of the samples; None before any.
    """

    value: float
    horizon_s: float
    confidence: float
    error: float | None


def line_fit(times_s: Collection[float], values: Collection[float], at_s: float) -> float:
    """Value at a time of the least squares line; their mean if all times are equal."""
    middle_t, middle_v = fmean(times_s), fmean(values)
    spread = sum((t - middle_t) ** 2 for t in times_s)
    if spread <= 0:
        return middle_v
    slope = sum((t - middle_t) * (v - middle_v) for t, v in zip(times_s, values, strict=True))
    return middle_v + slope / spread * (at_s - middle_t)


_SMOOTHING = (1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.005)
"""Weights of a new sample in the means that are forecasters; 1 is the newest value."""
_LINE = 10
_RIDGE = 100.0
_REMEMBERED = 3000.0
"""Of what learns: belief in the simple ones, and samples it remembers."""


class _Simple:
    """Forecasters that need no learning: means that fade, and half way along the line of ten."""

    COUNT = len(_SMOOTHING) + 1

    def __init__(self) -> None:
        self._means: list[float] = []
        self._seen = 0
        self._times: deque[float] = deque(maxlen=_LINE)
        self._values: deque[float] = deque(maxlen=_LINE)

    def sample(self, time_s: float, value: float, due_s: float) -> list[float]:
        if self._times and time_s <= self._times[-1]:
            self._times.clear()
            self._values.clear()
        self._times.append(time_s)
        self._values.append(value)
        self._seen += 1
        if not self._means:
            self._means = [value] * len(_SMOOTHING)
        self._means = [
            mean + max(weight, 1 / self._seen) * (value - mean)
            for weight, mean in zip(_SMOOTHING, self._means, strict=True)
        ]
        now = line_fit(self._times, self._values, time_s)
        then = line_fit(self._times, self._values, due_s)
        return [*self._means, now + 0.5 * (then - now)]


class Predictor:
    """Forecasts one number of one link.

    Args:
        horizon_s: How far ahead.
        least: Forecasts are never below; 100 kbit/s for rates, 1 ms for round trips.
        most: Never above.
        memory: Weight of old scores at each new one.
        period_s: Between samples, as far as known; says how many samples the horizon is.
        logarithmic: Whether to reckon with logarithms, as fits rates and round trips; ``least`` must
            then be more than 0.
        others: How many numbers beside it may know something.
    """

    def __init__(
        self,
        horizon_s: float = 1.0,
        *,
        least: float = -math.inf,
        most: float = math.inf,
        memory: float = 0.9995,
        period_s: float = 0.1,
        logarithmic: bool = False,
        others: int = 0,
    ) -> None:
        self.horizon_s = horizon_s
        self._least = least
        self._most = most
        self._newest_s = -math.inf
        self._issued: deque[tuple[float, tuple[float, ...], float]] = deque(maxlen=1000)
        self._memory = memory
        self._logarithmic = logarithmic
        self._simple = _Simple()
        ahead = max(1, round(horizon_s / period_s))
        self._learners = [
            LinearForecaster(ahead, _REMEMBERED, _RIDGE, groups=8, others=count)
            for count in ((0, others) if others else (0,))
        ]
        self._losses = [0.0] * (_Simple.COUNT + len(self._learners))
        self._weight = 0.0
        self._error = 0.0
        self._relative = 0.0

    def sample(self, time_s: float, value: float, others: Sequence[float | None] = ()) -> Forecast:
        """Take a sample and look ahead from it.

        Args:
            time_s: When it was taken.
            value: What it was.
            others: The numbers beside it, as many as were announced; None where one is missing.
        """
        if time_s < self._newest_s:
            # The clock was set back: what was promised for a time that comes again cannot be judged.
            self._issued.clear()
        self._newest_s = time_s
        self._score(time_s, value)
        return self._look_ahead(time_s, self._in(value), others)

    def _score(self, time_s: float, value: float) -> None:
        while self._issued and self._issued[0][0] <= time_s:
            due_s, forecasts, given = self._issued.popleft()
            # A sample that comes far too late says nothing about the moment that was meant.
            if time_s - due_s <= 0.5 * self.horizon_s:
                self._learn(value, forecasts, given)

    def _learn(self, value: float, forecasts: tuple[float, ...], given: float) -> None:
        keep = self._memory
        self._losses = [
            keep * loss + abs(forecast - value)
            for loss, forecast in zip(self._losses, forecasts, strict=True)
        ]
        error = abs(given - value)
        self._weight = keep * self._weight + 1
        self._error = keep * self._error + error
        self._relative = keep * self._relative + min(1.0, error / max(1e-9, abs(value), 0.1))

    def _look_ahead(self, time_s: float, value: float, others: Sequence[float | None]) -> Forecast:
        due_s = time_s + self.horizon_s
        guesses = self._simple.sample(time_s, value, due_s)
        base = self._joined(guesses)
        for learner, beside in zip(self._learners, ((), others), strict=False):
            guesses.append(learner.sample(value, base, beside))
        forecasts = tuple(self._out(guess) for guess in guesses)
        given = self._out(self._joined(guesses))
        self._issued.append((due_s, forecasts, given))
        if not self._weight:
            return Forecast(given, self.horizon_s, 0.0, None)
        confidence = 1 - self._relative / self._weight
        return Forecast(given, self.horizon_s, confidence, self._error / self._weight)

    def _in(self, value: float) -> float:
        return math.log(max(self._least, value)) if self._logarithmic else value

    def _out(self, guess: float) -> float:
        value = math.exp(min(100.0, guess)) if self._logarithmic else guess
        return min(self._most, max(self._least, value))

    def _joined(self, guesses: Sequence[float]) -> float:
        if self._weight < 3:
            # Nothing is known about anybody: the newest, a little smoothed.
            return fmean(guesses[:3])
        losses = self._losses[: len(guesses)]
        least = min(losses)
        scale = 0.02 * least + 1e-12
        weights = [math.exp(-(loss - least) / scale) for loss in losses]
        total = sum(weights)
        return sum(w * g for w, g in zip(weights, guesses, strict=True)) / total
