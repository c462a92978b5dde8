"""What to do when the network has no more to give: ask for less, then slow the application down. Pure.

The order of the paper's Fig. 9: after a first downgrade the request is lowered; if a further one comes, or the lower request is
refused, the application is asked to adapt; when the network has recovered both are taken back. A network that serves the
lower request need not say when it could serve more: after a while that is tried, one measure at a time, and ever more rarely
if it was too early.

Messages get lost. So every step has a time after which it is taken without one: who is not served long after a lower
request must slow down, and who has been slow without any news for very long tries more.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import Enum

from simple_ros_engines.network_exposure.maximizer.knobs import DELAYS, Setting
from simple_ros_engines.network_exposure.maximizer.resource import TopicTraffic, request_of

__all__ = ["Depletion", "Measure", "lowered"]

_MOST_TRIED = 4
_FASTER = 1.06


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
        settle_s: After a lower request the network has so long before a further downgrade counts.
        patience_s: So long all is served before more is tried; doubled each time that fails, up to sixteen times. So long
            a lower request may stay without a good answer.
        level: 0 nothing, 1 the request is lowered, 2 the application has adapted.
        is_trying: Whether more was asked for to see if it is given.
    """

    settle_s: float = 8.0
    patience_s: float = 15.0
    level: int = 0
    is_trying: bool = False
    _short: set[str] = field(default_factory=set)
    _acted_s: float = float("-inf")
    _recovers: bool = False
    _tried: int = 0

    @property
    def is_short(self) -> bool:
        """Whether the network gives less than was asked for."""
        return bool(self._short)

    @property
    def is_alert(self) -> bool:
        """Whether the network was short lately."""
        return self.level > 0 or self.is_trying

    def downgraded(self, topic: str, now_s: float) -> Measure | None:
        """The network gives a topic less than was asked for, or refuses what is asked."""
        self._short.add(topic)
        self._recovers = False
        # What was asked for before a measure may still be on its way down: only that is waited for.
        is_settled = now_s - self._acted_s >= self.settle_s
        return self._less(now_s) if is_settled or self.is_trying or self.level == 0 else None

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
        """Do what is overdue, or try for more if all was served long enough."""
        waited_s = now_s - self._acted_s
        if self._short:
            return self._overdue(waited_s, now_s)
        if waited_s < self.patience_s * 2**self._tried:
            return None
        if self.level == 0:
            self._tried, self.is_trying = 0, False
            return None
        return self._more(now_s)

    def _overdue(self, waited_s: float, now_s: float) -> Measure | None:
        """Nobody says that it is served: the answer may be lost, or there is none."""
        if self.level == 1 and waited_s >= self.patience_s:
            return self._less(now_s)
        if self.level == 2 and waited_s >= self.patience_s * 2**_MOST_TRIED:
            self._short.clear()
            return self._more(now_s)
        return None

    def _less(self, now_s: float) -> Measure | None:
        if self.level == 2:
            return None
        self._acted_s = now_s
        self._tried = min(_MOST_TRIED, self._tried + self.is_trying)
        self.is_trying = False
        self.level += 1
        return Measure.LOWER_REQUEST if self.level == 1 else Measure.ADAPT

    def _more(self, now_s: float) -> Measure:
        self.level -= 1
        self._acted_s = now_s
        self.is_trying = True
        return Measure.RESTORE if self.level == 1 else Measure.RAISE_REQUEST

    def _restored(self, now_s: float) -> Measure | None:
        if self._short or self.level == 0:
            return None
        self.level = 0
        self._recovers = False
        self._acted_s = now_s
        return Measure.RESTORE


def lowered(traffic: TopicTraffic, setting: Setting) -> Setting:
    """A lower request: as many notches more delay as it takes to need another class, at least one.

    A longer budget within the same class would be no other request, and so no answer would come to it. It must be
    another class also when the topic turns out to be a little faster than was measured.
    """
    now = _classes(traffic, setting)
    lower = one = setting.moved((1, 0, 0))
    while now & _classes(traffic, lower):
        if lower.delay == len(DELAYS) - 1:
            return one
        lower = lower.moved((1, 0, 0))
    return lower


def _classes(traffic: TopicTraffic, setting: Setting) -> set[int]:
    """The classes that may be asked for."""
    faster = replace(traffic, rate_hz=_FASTER * traffic.rate_hz)
    return {request_of(one, setting).qci for one in (traffic, faster)}
