"""The best linear forecast of a noisy series, learnt as it comes: pure.

What is foretold is how far the series will be from a base, its slow mean or somebody else's forecast, as a linear
combination of how far its newest samples and means of older groups are from its slow mean, in units of its
deviation; other series that may know something count along. The weights are the ridge regression of what came on
what was known then, over samples that fade exponentially; they are solved anew every few samples. Over the slow
mean, a series that wanders gets weight on its newest sample, a noisy one on the means, one that returns to its mean
little on either, one with a trend a negative weight on older groups.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["LinearForecaster"]

_BORDERS = (0, 1, 2, 4, 8, 16, 32, 64, 128)
_LIMIT = 6.0
"""Deviations beyond which an input counts no more: one that never moved says nothing by moving once."""

Floats = NDArray[np.float64]


class _Window:
    """The newest samples of one series, as group means about the slow mean, in deviations.

    Args:
        groups: How many groups, each twice as long as the one before.
        slowness: Weight of a sample in the slow mean.
    """

    def __init__(self, groups: int, slowness: float) -> None:
        borders = _BORDERS[: groups + 1]
        self.slow = 0.0
        self.deviation = 0.0
        self._sizes = np.diff(np.array(borders, np.float64))
        self._starts = np.array(borders[:-1])
        self._newest: Floats = np.zeros(borders[-1])
        self._slowness = slowness
        self._variance = 0.0
        self._count = 0

    def take(self, value: float | None) -> Floats:
        """The inputs after a sample; None repeats the one before, and says nothing where there was none."""
        if value is None:
            if not self._count:
                return np.zeros(self._sizes.size)
            value = float(self._newest[0])
        elif not self._count:
            self.slow = value
            self._newest[:] = value
        self._count += 1
        rate = max(self._slowness, 1 / self._count)
        self.slow += rate * (value - self.slow)
        self._variance += rate * ((value - self.slow) ** 2 - self._variance)
        self.deviation = math.sqrt(self._variance) + 1e-9
        self._newest[1:] = self._newest[:-1]
        self._newest[0] = value
        means = np.add.reduceat(self._newest, self._starts) / self._sizes
        inputs: Floats = np.clip((means - self.slow) / self.deviation, -_LIMIT, _LIMIT)
        return inputs


class LinearForecaster:
    """Foretells one series.

    Args:
        ahead: How many samples ahead, at least 1.
        memory: For how many samples mean and weights remember.
        ridge: Samples' worth of belief in the base.
        solve_every: Samples between solutions.
        groups: Groups of newest samples of the series, each twice as long as the one before: 6 look back over 32.
        others: Series that may know something, each with six groups.
    """

    def __init__(
        self,
        ahead: int = 1,
        memory: float = 1000.0,
        ridge: float = 5.0,
        solve_every: int = 10,
        *,
        groups: int = 6,
        others: int = 0,
    ) -> None:
        slowness = 4 / memory
        self._windows = [_Window(groups, slowness), *(_Window(6, slowness) for _ in range(others))]
        size = groups + 6 * others
        self._keep = 1 - 1 / memory
        self._ridge = ridge * np.eye(size)
        self._solve_every = solve_every
        self._known: deque[tuple[Floats, float, float, float]] = deque(maxlen=max(1, ahead))
        self._products: Floats = np.zeros((size, size))
        self._targets: Floats = np.zeros(size)
        self._weights: Floats | None = None
        self._count = 0
        self._learnt = 0
        self._error = 0.0

    @property
    def deviation(self) -> float:
        """Usual distance of a forecast to what came."""
        return math.sqrt(self._error)

    def sample(
        self, value: float, base: float | None = None, others: Sequence[float | None] = ()
    ) -> float:
        """Take a sample; gives the forecast from here.

        Args:
            value: The sample.
            base: What is expected already, from which the forecast goes at most one deviation; None for the slow mean.
            others: Newest values of the other series; None repeats the one before.
        """
        own, *rest = self._windows
        self._count += 1
        if len(self._known) == self._known.maxlen:
            self._learn(*self._known[0], value)
        parts = [own.take(value)]
        parts += [window.take(other) for window, other in zip(rest, others, strict=True)]
        inputs: Floats = np.concatenate(parts) if rest else parts[0]
        correction = self._correction(inputs, base is None)
        if base is None:
            base = own.slow
        else:
            correction = max(-1.0, min(1.0, correction))
        forecast = base + own.deviation * correction
        self._known.append((inputs, base, own.deviation, forecast))
        return forecast

    def _correction(self, inputs: Floats, is_alone: bool) -> float:
        if self._weights is None:
            # Nothing is learnt yet: the newest value, or the base.
            return float(inputs[0]) if is_alone else 0.0
        return float(self._weights @ inputs)

    def _learn(
        self, inputs: Floats, base: float, deviation: float, forecast: float, came: float
    ) -> None:
        self._learnt += 1
        rate = max(1 - self._keep, 1 / self._learnt)
        self._error += rate * ((came - forecast) ** 2 - self._error)
        target = max(-_LIMIT, min(_LIMIT, (came - base) / deviation))
        self._products *= self._keep
        self._products += inputs[:, None] * inputs
        self._targets *= self._keep
        self._targets += target * inputs
        if self._count % self._solve_every == 0:
            solved = np.linalg.solve(self._products + self._ridge, self._targets)
            self._weights = solved.astype(np.float64)
