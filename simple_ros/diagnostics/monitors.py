"""Things to watch: how often something happens, how late stamps are, whether it happens at all.

Pure: whoever watches says what time it is, in seconds. Each monitor is a task of an updater: it writes
what it found into a `Status`.
"""

from __future__ import annotations

import math
from collections import deque

from simple_ros.diagnostics.status import ERROR, OK, WARN, Status
from simple_ros.errors import ConfigError

__all__ = ["DelayMonitor", "FrequencyMonitor", "Heartbeat"]


class FrequencyMonitor:
    """Whether something happens as often as it should.

    It is an error if nothing happened, a warning if the rate is outside of the limits. The rate is taken
    over the last ``window`` looks.

    Args:
        min_hz: Lowest rate that is right.
        max_hz: Highest rate that is right; None has no limit.
        tolerance: Part of the limits by which the rate may miss them.
        window: Looks that count.

    Raises:
        ConfigError: The limits make no sense.
    """

    def __init__(
        self,
        min_hz: float,
        max_hz: float | None = None,
        *,
        tolerance: float = 0.1,
        window: int = 5,
    ) -> None:
        upper = math.inf if max_hz is None else max_hz
        if not (0 <= min_hz <= upper) or tolerance < 0 or window < 1:
            raise ConfigError(
                f"rates are 0 <= min <= max, the tolerance >= 0 and the window >= 1, not "
                f"{min_hz}, {max_hz}, {tolerance} and {window}"
            )
        self._min_hz = min_hz
        self._max_hz = upper
        self._tolerance = tolerance
        self._count = 0
        self._looks: deque[tuple[float, int]] = deque(maxlen=window)

    def tick(self, now_s: float) -> None:
        """It happened now."""
        if not self._looks:
            self._looks.append((now_s, 0))
        self._count += 1

    def run(self, status: Status, now_s: float) -> None:
        """Look at the rate since the first look in the window, and write it down."""
        since_s, before = self._looks[0] if self._looks else (now_s, self._count)
        self._looks.append((now_s, self._count))
        events, spanned_s = self._count - before, now_s - since_s
        rate_hz = events / spanned_s if spanned_s > 0 else 0.0
        if not events:
            status.merge_summary(ERROR, "nothing happens")
        elif rate_hz < self._min_hz * (1 - self._tolerance):
            status.merge_summary(WARN, f"too seldom: {rate_hz:.2f} Hz")
        elif rate_hz > self._max_hz * (1 + self._tolerance):
            status.merge_summary(WARN, f"too often: {rate_hz:.2f} Hz")
        else:
            status.merge_summary(OK, f"{rate_hz:.2f} Hz")
        status.add("events in window", events)
        status.add("events in all", self._count)
        status.add("rate (Hz)", rate_hz)
        status.add("lowest right rate (Hz)", self._min_hz)
        if self._max_hz < math.inf:
            status.add("highest right rate (Hz)", self._max_hz)


class DelayMonitor:
    """Whether stamps are neither too old nor in the future when they arrive.

    Args:
        max_delay_s: Largest delay that is right, in seconds.
        min_delay_s: Smallest one; a stamp from the future has a negative delay.

    Raises:
        ConfigError: The limits make no sense.
    """

    def __init__(self, max_delay_s: float = 5.0, min_delay_s: float = -1.0) -> None:
        if not min_delay_s <= max_delay_s:
            raise ConfigError(f"delays are min <= max, not {min_delay_s} and {max_delay_s}")
        self._min_s = min_delay_s
        self._max_s = max_delay_s
        self._least_s = math.inf
        self._most_s = -math.inf
        self._unstamped = 0
        self._was_wrong = 0

    def tick(self, stamp_s: float, now_s: float) -> None:
        """Something with that stamp arrived; 0 means that it was not stamped."""
        if stamp_s == 0:
            self._unstamped += 1
            return
        delay_s = now_s - stamp_s
        self._least_s = min(self._least_s, delay_s)
        self._most_s = max(self._most_s, delay_s)
        if not self._min_s <= delay_s <= self._max_s:
            self._was_wrong += 1

    def run(self, status: Status, now_s: float) -> None:  # noqa: ARG002
        """Write down what arrived since the last look."""
        seen = self._least_s <= self._most_s
        if self._unstamped:
            status.merge_summary(WARN, "no stamp was set")
        if seen and self._least_s < self._min_s:
            status.merge_summary(ERROR, f"stamps are {-self._least_s:.3f} s in the future")
        if seen and self._most_s > self._max_s:
            status.merge_summary(ERROR, f"stamps are {self._most_s:.3f} s old")
        if status.message == "":
            status.summary(OK if seen else WARN, "stamps are right" if seen else "nothing arrived")
        if seen:
            status.add("smallest delay (s)", self._least_s)
            status.add("largest delay (s)", self._most_s)
        status.add("wrong delays in all", self._was_wrong)
        self._least_s, self._most_s, self._unstamped = math.inf, -math.inf, 0


class Heartbeat:
    """Says that the program lives; an error once a beat is late.

    Args:
        within_s: Seconds within which `beat` must be called; None asks for no beats.
    """

    def __init__(self, within_s: float | None = None) -> None:
        self._within_s = within_s
        self._beat_s: float | None = None

    def beat(self, now_s: float) -> None:
        """It lives."""
        self._beat_s = now_s

    def run(self, status: Status, now_s: float) -> None:
        """Write down whether it lives."""
        if self._within_s is None:
            status.merge_summary(OK, "alive")
        elif self._beat_s is None:
            status.merge_summary(WARN, "no beat yet")
        else:
            late = now_s - self._beat_s > self._within_s
            status.merge_summary(ERROR if late else OK, "no beat" if late else "alive")
            status.add("last beat (s ago)", now_s - self._beat_s)
