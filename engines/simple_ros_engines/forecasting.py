"""The best linear forecast of a noisy series, learnt as it comes: pure.

What is foretold is how far the series will be from its slow mean, as a linear combination of how far its
newest samples and means of older groups are. The weights are the ridge regression of what came on what was
known then, over samples that fade exponentially; they are solved anew every few samples. A series that
wanders gets weight on its newest sample, a noisy one on the means, one that returns to its mean little on
either, one with a trend a negative weight on older groups.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

__all__ = ["LinearForecaster"]

_GROUPS = ((0, 1), (1, 2), (2, 4), (4, 8), (8, 16), (16, 32))
_LONGEST = _GROUPS[-1][1]
_SIZES = np.array([b - a for a, b in _GROUPS], np.float64)
_STARTS = np.array([a for a, _ in _GROUPS])

Floats = NDArray[np.float64]


class LinearForecaster:
    """Foretells one series.

    Args:
        ahead: How many samples ahead, at least 1.
        memory: For how many samples mean and weights remember.
        ridge: Samples' worth of belief in no change from the slow mean.
        solve_every: Samples between solutions.
    """

    def __init__(
        self, ahead: int = 1, memory: float = 1000.0, ridge: float = 5.0, solve_every: int = 10
    ) -> None:
        size = len(_GROUPS)
        self._keep = 1 - 1 / memory
        self._slowness = 4 / memory
        self._ridge = ridge
        self._solve_every = solve_every
        self._newest: Floats = np.zeros(_LONGEST)
        self._known: deque[tuple[Floats, float]] = deque(maxlen=max(1, ahead))
        self._products: Floats = np.zeros((size, size))
        self._targets: Floats = np.zeros(size)
        self._weights: Floats = np.zeros(size)
        self._weights[0] = 1.0
        self._slow = 0.0
        self._variance = 0.0
        self._count = 0

    def sample(self, value: float) -> float:
        """Take a sample; gives the forecast from here."""
        if not self._count:
            self._slow = value
            self._newest[:] = value
        self._count += 1
        rate = max(self._slowness, 1 / self._count)
        self._slow += rate * (value - self._slow)
        self._variance += rate * ((value - self._slow) ** 2 - self._variance)
        self._newest[1:] = self._newest[:-1]
        self._newest[0] = value
        if len(self._known) == self._known.maxlen:
            self._learn(*self._known[0], value)
        inputs = np.add.reduceat(self._newest, _STARTS) / _SIZES - self._slow
        self._known.append((inputs, self._slow))
        return self._slow + float(self._weights @ inputs)

    def _learn(self, inputs: Floats, slow: float, came: float) -> None:
        self._products *= self._keep
        self._products += inputs[:, None] * inputs
        self._targets *= self._keep
        self._targets += inputs * (came - slow)
        if self._count % self._solve_every == 0:
            scale = self._ridge * self._variance + 1e-9
            system = self._products + scale * np.eye(len(_GROUPS))
            self._weights[:] = np.linalg.solve(system, self._targets)
