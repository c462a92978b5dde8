"""Which messages of a topic go out, and how large: bytes are given up before messages. Pure."""

from __future__ import annotations

import math

from simple_ros_engines.cross_domain.adaptation import RateGate
from simple_ros_engines.cross_domain.jpeg import JpegLadder, Look
from simple_ros_engines.cross_domain.treatment import (
    UNTOUCHED_RATIO,
    FlowBudget,
    Reluctant,
    Treatment,
)

__all__ = ["FlowRules"]

_NEW = 0.2
_SPARE = 1.1
"""What a topic is left beyond its mean rate."""
_LEAST_SHARE = 0.05


class FlowRules:
    """Rules of one topic of one link.

    Once a strategy has told how many bits a second there are, JPEGs give up quality first, then pixels, clouds give up
    points, and only what does not fit then is left out. Until then the constraint's frame rate holds.

    Args:
        dwell_s: How long the link must have been better before messages are made larger.

    Attributes:
        budget: Of the topic.
        ladder: Of its pictures.
    """

    def __init__(self, dwell_s: float = 2.0) -> None:
        self.budget = FlowBudget()
        self.ladder = JpegLadder(dwell_s)
        self._gate = RateGate()
        self._share = Reluctant(1.0, dwell_s)
        self._came_bytes = 0.0
        self._gain = 1.0

    def came(self, size_bytes: int, now_s: float) -> None:
        """A message came in."""
        self.budget.came(now_s)
        new = _NEW if self._came_bytes else 1.0
        self._came_bytes += new * (size_bytes - self._came_bytes)

    def wanted_bps(self, *, as_jpeg: bool) -> float:
        """What the topic would take; as JPEG any budget is of use."""
        coming_hz = self.budget.coming_hz
        return math.inf if as_jpeg or not coming_hz else 8 * _SPARE * coming_hz * self._came_bytes

    def strategy(self, rate_bps: float, ratio: float, now_s: float) -> None:
        """A strategy came: bits a second for this topic, infinite for not told; a ratio of 0 says nothing."""
        self.budget.rate_bps = rate_bps
        self.ladder.want(ratio or 1.0, now_s)

    def fits_as_it_came(self, size_bytes: int, now_s: float) -> bool:
        """Whether messages of this size fit, all that come."""
        return self._fitting(size_bytes, now_s) >= UNTOUCHED_RATIO

    def cloud_share(self, treatment: Treatment, size_bytes: int, now_s: float) -> float:
        """What part of its bytes a cloud shall keep; 1: as it came."""
        asked = 1.0 if treatment.is_untouched else (treatment.scale / 100) ** 2 * treatment.ratio
        share = min(asked, self._fitting(size_bytes, now_s))
        return 1.0 if share >= UNTOUCHED_RATIO else share

    def cloud_bytes(self, share: float, size_bytes: int) -> float:
        """What a cloud of this size will take, thinned so."""
        return size_bytes * (1.0 if share == 1 else min(1.0, share * self._gain))

    def _fitting(self, size_bytes: int, now_s: float) -> float:
        fits = self.budget.message_bytes() / max(1, size_bytes)
        if fits < UNTOUCHED_RATIO:
            fits /= self._gain
        return self._share.want(max(_LEAST_SHARE, min(1.0, fits)), now_s)

    def thinned(self, share: float, before_bytes: int, after_bytes: int) -> None:
        """A cloud that was to keep a share was thinned: how far off that was, later clouds make good."""
        if share < 1 and before_bytes:
            off = after_bytes / (share * before_bytes)
            self._gain += _NEW * (max(0.5, min(4.0, off)) - self._gain)

    def look(self, treatment: Treatment, now_s: float) -> Look:
        """How to make the next JPEG."""
        return self.ladder.look(treatment.scale, self.budget.message_bytes(), now_s)

    def passes(
        self, treatment: Treatment, now_s: float, expected_bytes: float | None = None
    ) -> bool:
        """Whether a message that came now goes out.

        Args:
            treatment: Of the link.
            now_s: A clock that never jumps.
            expected_bytes: What it will take, if that can be told; else as much as those before.
        """
        limit_hz = self.budget.limit_hz(treatment.rate_hz)
        rate_hz = self.budget.rate_hz(limit_hz, expected_bytes)
        self._gate.rate_hz = 0.0 if math.isinf(rate_hz) else rate_hz
        return self._gate.passes(now_s)

    def sent(self, size_bytes: int, look: Look | None = None) -> None:
        """A message went out, as a JPEG that looks so, or otherwise."""
        self.budget.sent(size_bytes)
        if look is not None:
            self.ladder.produced(size_bytes, self.budget.message_bytes(), look)
