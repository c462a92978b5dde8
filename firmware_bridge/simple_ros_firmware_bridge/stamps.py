"""Times that a board without a clock puts into its messages, in time of this host.

Micro-ROS asks the time once and believes any answer; many boards never ask and stamp with zero or with the
time since they were switched on. A sample is never here before it was taken: the least ``arrival - stamp``
over some seconds is the offset of the clocks plus the shortest way, and what is above it is delay.
"""

from __future__ import annotations

from collections import deque

__all__ = ["OffsetFilter", "needs_new_stamp"]

_EPOCH_FROM_NS = 10**9 * 1_000_000_000
"""Stamps before 2001 count time since the board was switched on."""


def needs_new_stamp(stamp_ns: int) -> bool:
    """Whether a stamp cannot be a time of day."""
    return stamp_ns < _EPOCH_FROM_NS


class OffsetFilter:
    """The offset of a board's clock, over a sliding window.

    Args:
        window_ns: How long the least offset counts; drift is followed at that pace.
        jump_ns: A stamp that goes back by more means that the board was started anew.
    """

    def __init__(self, window_ns: int = 10 * 10**9, jump_ns: int = 10**9) -> None:
        self._window_ns = window_ns
        self._jump_ns = jump_ns
        self._least: deque[tuple[int, int]] = deque()
        self._last_stamp_ns: int | None = None

    @property
    def offset_ns(self) -> int | None:
        """To add to stamps of the board; None before the first."""
        return self._least[0][1] if self._least else None

    def restamped(self, stamp_ns: int, arrival_ns: int) -> int:
        """The time, on the clock of ``arrival_ns``, at which a sample was taken.

        A stamp of 0 says nothing: then it is its arrival.
        """
        if stamp_ns == 0:
            return arrival_ns
        if self._last_stamp_ns is not None and stamp_ns < self._last_stamp_ns - self._jump_ns:
            self._least.clear()
        self._last_stamp_ns = stamp_ns
        offset = arrival_ns - stamp_ns
        while self._least and self._least[-1][1] >= offset:
            self._least.pop()
        self._least.append((arrival_ns, offset))
        while self._least[0][0] < arrival_ns - self._window_ns:
            self._least.popleft()
        return min(arrival_ns, stamp_ns + self._least[0][1])
