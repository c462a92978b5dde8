"""What comes before congestion on a link: learnt from the link itself. Pure.

A logistic model over a few features of buffer and round trip, trained as time goes on: a sample is labelled when
it is known whether the round trip rose far above its least within the next `HORIZON` samples. Congestion is rare,
so its examples weigh as much as all others together. Until it has seen enough of both kinds it says nothing.
"""

from __future__ import annotations

import math
from collections import deque

__all__ = ["HORIZON", "CongestionLearner"]

HORIZON = 10
_FEATURES = 6
_LEAST_EXAMPLES = 20
_RATE = 0.05
_DECAY = 1e-4
_REMEMBERED = 600


class CongestionLearner:
    """Learns one link.

    Args:
        bloat_ms: A round trip so much above the least is congestion.
        threshold: Probability from which it warns.

    Attributes:
        probability: Of congestion soon, at the newest sample; 0 while it knows too little.
        positives: Examples of congestion it has learnt from.
        negatives: Others.
    """

    def __init__(self, bloat_ms: float = 30.0, threshold: float = 0.7) -> None:
        self.probability = 0.0
        self.positives = 0
        self.negatives = 0
        self._bloat_ms = bloat_ms
        self._threshold = threshold
        self._weights = [0.0] * _FEATURES
        self._buffers: deque[float] = deque(maxlen=10)
        self._rtts: deque[float] = deque(maxlen=10)
        self._all_rtts: deque[float] = deque(maxlen=_REMEMBERED)
        self._unlabelled: deque[list[float]] = deque()

    def sample(self, buffer_bytes: float | None, rtt_ms: float | None) -> bool:
        """Take a sample; tells whether congestion is to be expected. Both must be known."""
        if buffer_bytes is None or rtt_ms is None:
            return False
        self._buffers.append(buffer_bytes)
        self._rtts.append(rtt_ms)
        self._all_rtts.append(rtt_ms)
        congests = rtt_ms - min(self._all_rtts) > self._bloat_ms
        self._label(congests)
        if len(self._buffers) < 10:
            return False
        features = self._features()
        if not congests:
            # What congests already needs no foresight, and would teach the obvious.
            self._unlabelled.append(features)
        knows = min(self.positives, self.negatives) >= _LEAST_EXAMPLES
        self.probability = self._predicted(features) if knows else 0.0
        return self.probability >= self._threshold

    def _features(self) -> list[float]:
        buffers, rtts = list(self._buffers), list(self._rtts)
        least = min(self._all_rtts)
        kilobytes = [math.log1p(value / 1000) for value in buffers]
        bloat = [math.log1p(max(0.0, value - least)) for value in rtts]
        return [
            1.0,
            kilobytes[-1] / 5,
            (sum(kilobytes[7:]) / 3 - sum(kilobytes[:7]) / 7) / 2,
            bloat[-1] / 3,
            (sum(bloat[7:]) / 3 - sum(bloat[:7]) / 7) / 2,
            kilobytes[-1] - kilobytes[-2],
        ]

    def _predicted(self, features: list[float]) -> float:
        total = sum(w * x for w, x in zip(self._weights, features, strict=True))
        return 1 / (1 + math.exp(-max(-30.0, min(30.0, total))))

    def _label(self, congests: bool) -> None:
        if congests:
            while self._unlabelled:
                self._learn(self._unlabelled.popleft(), 1.0)
        elif len(self._unlabelled) >= HORIZON:
            self._learn(self._unlabelled.popleft(), 0.0)

    def _learn(self, features: list[float], label: float) -> None:
        if label:
            self.positives += 1
        else:
            self.negatives += 1
        seen = self.positives if label else self.negatives
        weight = min(10.0, (self.positives + self.negatives) / (2 * seen))
        error = label - self._predicted(features)
        self._weights = [
            (1 - _DECAY) * w + _RATE * weight * error * x
            for w, x in zip(self._weights, features, strict=True)
        ]
