"""What to do when the network has no more to give: ask for less, then slow the application down. Pure.

The order of the paper's Fig. 9: after a first downgrade the request is lowered; if a further one comes, or the lower request is
refused, the application is asked to adapt; when the network has recovered both are taken back. A network that serves the
lower request need not say when it could serve more: after a while that is tried, one measure at a time, and ever more rarely
if it was too early.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

__all__ = ["Depletion", "Measure"]

_MOST_TRIED = 4


class Measure(Enum):
    """What is to be done for a process."""

    LOWER_REQUEST = "lower request"
    ADAPT = "adapt"
    RAISE_REQUEST = "raise request"
    RESTORE = "restore"


@dataclass(slots=True)
class Depletion:
    """One process whose topics the network serves.

    Attributes:
        settle_s: After a measure the network has so long before a further downgrade counts.
        patience_s: So long all is served before more is tried; doubled each time that fails, up to sixteen times.
        level: 0 nothing, 1 the request is lowered, 2 the application has adapted.
    """

    settle_s: float = 2.0
    patience_s: float = 15.0
    level: int = 0
    _short: set[str] = field(default_factory=set)
    _acted_s: float = float("-inf")
    _recovers: bool = False
    _tried: int = 0
    _is_trying: bool = False

    @property
    def is_short(self) -> bool:
        """Whether the network gives less than was asked for."""
        return bool(self._short)

    def downgraded(self, topic: str, now_s: float) -> Measure | None:
        """The network gives a topic less than was asked for, or refuses what is asked."""
        self._short.add(topic)
        self._recovers = False
        if now_s - self._acted_s < self.settle_s or self.level == 2:
            return None
        self._acted_s = now_s
        self._tried = min(_MOST_TRIED, self._tried + self._is_trying)
        self._is_trying = False
        self.level += 1
        return Measure.LOWER_REQUEST if self.level == 1 else Measure.ADAPT

    def granted(self, topic: str, now_s: float) -> Measure | None:
        """The network gives what is asked for now: a new operation point, which stays unless the network recovers."""
        self._short.discard(topic)
        return self._restored(now_s) if self._recovers else None

    def recovered(self, topic: str, now_s: float) -> Measure | None:
        """The network gives a topic all again."""
        self._short.discard(topic)
        self._recovers = True
        return self._restored(now_s)

    def tick(self, now_s: float) -> Measure | None:
        """Try for more, if all was served long enough."""
        wait_s = self.patience_s * 2**self._tried
        if self.is_short or now_s - self._acted_s < wait_s:
            return None
        if self.level == 0:
            self._tried, self._is_trying = 0, False
            return None
        self.level -= 1
        self._acted_s = now_s
        self._is_trying = True
        return Measure.RESTORE if self.level == 1 else Measure.RAISE_REQUEST

    def _restored(self, now_s: float) -> Measure | None:
        if self._short or self.level == 0:
            return None
        self.level = 0
        self._recovers = False
        self._acted_s = now_s
        return Measure.RESTORE
