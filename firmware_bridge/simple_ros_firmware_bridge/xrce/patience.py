"""How long to wait for a message that a board may have sent in vain, before asking for it again.

A board that publishes reliably waits for the ACKNACK of each message. When a message or its ACKNACK is
lost, both sides are silent, and who asks first ends it. Asking for a message that was never sent costs a
few bytes. Asking for one that is still on its way costs the board that message once more, and a slow board
that is asked too early sends everything again and again.

So the harm itself is measured. Each message that came twice because it was asked for too early doubles the
wait; each one that came once shortens it by 2 %. In balance ``ln(1.02) / ln(2)``, that is 3 % of messages,
are sent needlessly, at whatever speed the board has. Below it lies what no question can beat: the
shortest gap between an answer of ours and the next message, which is at least a round trip, and a quarter.
"""

from __future__ import annotations

from collections import deque

__all__ = ["Patience"]

_FLOOR_S = 0.005
_CEILING_S = 1.0
_START_S = 0.03
_SHORTER = 1 / 1.02
_LONGER = 2.0
_BACK_OFF = 1.5
_GAPS = 64
_GAP_MARGIN = 1.25
_GIVE_UP_S = 1.6
"""A board waits for an answer for 1 s, then publishes the next; what was lost shows as a hole then."""


class Patience:
    """The rule, for one reliable stream of one board. Times are seconds of any monotonic clock.

    Args:
        start_s: The first wait, before anything was learnt.
    """

    def __init__(self, start_s: float = _START_S) -> None:
        self._wait_s = start_s
        self._gaps: deque[float] = deque(maxlen=_GAPS)

    @property
    def wait_s(self) -> float:
        """How long a silence must be before something is asked for."""
        least = max(_FLOOR_S, _GAP_MARGIN * min(self._gaps, default=0.0))
        return min(_CEILING_S, max(self._wait_s, least))

    def wait_after(self, asked: int) -> float:
        """The wait after having asked ``asked`` times without any answer."""
        return float(min(_CEILING_S, self.wait_s * _BACK_OFF**asked))

    def still_asks(self, silence_s: float) -> bool:
        """Whether asking makes sense after so long a silence."""
        return silence_s < _GIVE_UP_S

    def came(self, gap_s: float | None) -> None:
        """A message came, ``gap_s`` after the answer it waited for; None if that is not known."""
        self._wait_s = max(_FLOOR_S, self._wait_s * _SHORTER)
        if gap_s is not None:
            self._gaps.append(gap_s)

    def came_twice(self) -> None:
        """A message that was asked for was on its way already."""
        self._wait_s = min(_CEILING_S, self.wait_s * _LONGER)
