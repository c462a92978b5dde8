"""What a number will be in a moment: several simple forecasters, the one that proved best speaks. Pure.

Every forecaster issues a forecast with each sample; when its time has come it is scored by what really
came. The forecast that is given is the mean of all, weighted by how they did (Cesa-Bianchi and Lugosi,
"Prediction, Learning, and Games", 2006, ch. 2): smooth where noise rules, the newest value where the
number wanders, a line where it goes somewhere, and a linear combination that is learnt
(`forecasting.LinearForecaster`). Confidence is one minus the mean relative error.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import fmean, median

from simple_ros_engines.forecasting import LinearForecaster

__all__ = ["FORECASTERS", "Forecast", "Predictor", "line_fit", "theil_sen"]

Forecaster = Callable[[Sequence[float], Sequence[float], float], float]


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


def line_fit(times_s: Sequence[float], values: Sequence[float], at_s: float) -> float:
    """Value at a time of the least squares line; their mean if all times are equal."""
    middle_t, middle_v = fmean(times_s), fmean(values)
    spread = sum((t - middle_t) ** 2 for t in times_s)
    if spread <= 0:
        return middle_v
    slope = sum((t - middle_t) * (v - middle_v) for t, v in zip(times_s, values, strict=True))
    return middle_v + slope / spread * (at_s - middle_t)


def theil_sen(times_s: Sequence[float], values: Sequence[float], at_s: float) -> float:
    """Value at a time of the line with the median of all slopes, which outliers do not turn."""
    slopes = [
        (values[j] - values[i]) / (times_s[j] - times_s[i])
        for i in range(len(values))
        for j in range(i + 1, len(values))
        if times_s[j] > times_s[i]
    ]
    if not slopes:
        return median(values)
    slope = median(slopes)
    level = median(v - slope * t for t, v in zip(times_s, values, strict=True))
    return level + slope * at_s


def _newest(_: Sequence[float], values: Sequence[float], __: float) -> float:
    return values[-1]


def _mean_of(count: int) -> Forecaster:
    def forecast(_: Sequence[float], values: Sequence[float], __: float) -> float:
        return fmean(values[-count:])

    return forecast


def _smoothed(alpha: float) -> Forecaster:
    def forecast(_: Sequence[float], values: Sequence[float], __: float) -> float:
        level = values[0]
        for value in values:
            level += alpha * (value - level)
        return level

    return forecast


def _damped_line(count: int, damping: float) -> Forecaster:
    def forecast(times_s: Sequence[float], values: Sequence[float], at_s: float) -> float:
        times, recent = times_s[-count:], values[-count:]
        now = line_fit(times, recent, times[-1])
        return now + damping * (line_fit(times, recent, at_s) - now)

    return forecast


FORECASTERS: dict[str, Forecaster] = {
    "newest": _newest,
    "mean of 3": _mean_of(3),
    "mean of 10": _mean_of(10),
    "mean of all": _mean_of(50),
    "smoothed 0.3": _smoothed(0.3),
    "half line of 10": _damped_line(10, 0.5),
}
"""The forecasters that need no learning, by name; the linear one comes on top."""


class Predictor:
    """Forecasts one number of one link.

    Args:
        horizon_s: How far ahead.
        least: Forecasts are never below; 100 kbit/s for rates, 1 ms for round trips.
        most: Never above.
        window: Samples looked at.
        memory: Weight of old scores at each new one.
        period_s: Between samples, as far as known; says how many samples the horizon is.
        logarithmic: Whether to reckon with logarithms, as fits rates and round trips; ``least`` must
            then be more than 0.
    """

    def __init__(
        self,
        horizon_s: float = 1.0,
        *,
        least: float = -math.inf,
        most: float = math.inf,
        window: int = 50,
        memory: float = 0.9995,
        period_s: float = 0.1,
        logarithmic: bool = False,
    ) -> None:
        self.horizon_s = horizon_s
        self._least = least
        self._most = most
        self._times: deque[float] = deque(maxlen=window)
        self._values: deque[float] = deque(maxlen=window)
        self._issued: deque[tuple[float, tuple[float, ...], float]] = deque(maxlen=1000)
        self._memory = memory
        self._logarithmic = logarithmic
        self._linear = LinearForecaster(max(1, round(horizon_s / period_s)))
        self._losses = [0.0] * (len(FORECASTERS) + 1)
        self._weight = 0.0
        self._error = 0.0
        self._relative = 0.0

    def sample(self, time_s: float, value: float) -> Forecast:
        """Take a sample and look ahead from it."""
        if self._times and time_s <= self._times[-1]:
            self._forget_times(time_s)
        self._score(time_s, value)
        self._times.append(time_s)
        self._values.append(self._in(value))
        return self._look_ahead(time_s)

    def _forget_times(self, time_s: float) -> None:
        # The clock was set back: what was promised for a time that comes again cannot be judged.
        if time_s < self._times[-1]:
            self._issued.clear()
        self._times.clear()
        self._values.clear()

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

    def _look_ahead(self, time_s: float) -> Forecast:
        due_s = time_s + self.horizon_s
        times, values = list(self._times), list(self._values)
        guesses = [one(times, values, due_s) for one in FORECASTERS.values()]
        # A combination may point anywhere; nothing new is expected from it.
        linear = self._linear.sample(values[-1])
        guesses.append(max(min(values), min(max(values), linear)))
        forecasts = tuple(self._out(guess) for guess in guesses)
        bounded = self._joined(forecasts)
        self._issued.append((due_s, forecasts, bounded))
        if not self._weight:
            return Forecast(bounded, self.horizon_s, 0.0, None)
        confidence = 1 - self._relative / self._weight
        return Forecast(bounded, self.horizon_s, confidence, self._error / self._weight)

    def _in(self, value: float) -> float:
        return math.log(max(self._least, value)) if self._logarithmic else value

    def _out(self, guess: float) -> float:
        value = math.exp(min(100.0, guess)) if self._logarithmic else guess
        return min(self._most, max(self._least, value))

    def _joined(self, forecasts: tuple[float, ...]) -> float:
        if self._weight < 3:
            # Nothing is known about anybody: the smooth middle.
            return fmean(forecasts[:3])
        least = min(self._losses)
        scale = 0.02 * least + 1e-12
        weights = [math.exp(-(loss - least) / scale) for loss in self._losses]
        total = sum(weights)
        return sum(w * f for w, f in zip(weights, forecasts, strict=True)) / total
