"""What an application is asked to be: by whom, how fast, how often, until when. Pure.

Several may ask: the maximizer, and the network itself. The slowest request counts, so that nobody undoes what another still
needs. A request that is not said again in time ends by itself: whoever asked may be dead.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from dataclasses import dataclass

__all__ = ["ADAPTATION_TOPIC", "Adaptations", "is_meant"]

ADAPTATION_TOPIC = "/application_adaptation_request"
_LEAST, _MOST = 0.05, 4.0
_MOST_REQUESTERS = 64


@dataclass(frozen=True, slots=True)
class _Wish:
    speed: float
    rate: float
    until_s: float
    reason: str


def is_meant(group: str, topics: Iterable[str], own: str, own_topics: Collection[str]) -> bool:
    """Whether a request for a group and topics is for this application; one for nobody is for everybody.

    Args:
        group: That is named.
        topics: That are named.
        own: Name of this application's group.
        own_topics: Of this application, without a leading slash.
    """
    named = {topic.lstrip("/") for topic in topics}
    if not group and not named:
        return True
    return group == own or any(topic in named for topic in own_topics)


class Adaptations:
    """The requests in force."""

    def __init__(self) -> None:
        self._wishes: dict[str, _Wish] = {}

    def came(
        self,
        requester: str,
        speed: float,
        rate: float,
        valid_s: float,
        now_s: float,
        reason: str = "",
    ) -> bool:
        """Somebody asks; returns whether it made sense.

        Args:
            requester: Who.
            speed: Share of the own speed, 0 for as it was; taken as 0.05 to 4.
            rate: Share of the own rate, likewise.
            valid_s: Counts so long; 0 until the same requester says otherwise.
            now_s: The time.
            reason: In words.
        """
        if not all(math.isfinite(number) and number >= 0 for number in (speed, rate, valid_s)):
            return False
        before = self._wishes.pop(requester, _Wish(1.0, 1.0, 0.0, ""))
        wish = _Wish(
            _within(speed) if speed else before.speed,
            _within(rate) if rate else before.rate,
            now_s + valid_s if valid_s else math.inf,
            reason,
        )
        if (wish.speed, wish.rate) != (1.0, 1.0) and len(self._wishes) < _MOST_REQUESTERS:
            self._wishes[requester] = wish
        return True

    def speed(self, now_s: float) -> float:
        """Share of the own speed to drive at."""
        return min((wish.speed for wish in self._live(now_s) if wish.speed != 1.0), default=1.0)

    def rate(self, now_s: float) -> float:
        """Share of the own rate to work at."""
        return min((wish.rate for wish in self._live(now_s) if wish.rate != 1.0), default=1.0)

    def reason(self, now_s: float) -> str:
        """Why, in words; empty if nobody asks for anything."""
        return "; ".join(wish.reason for wish in self._live(now_s) if wish.reason)

    def _live(self, now_s: float) -> list[_Wish]:
        self._wishes = {
            requester: wish for requester, wish in self._wishes.items() if wish.until_s > now_s
        }
        return list(self._wishes.values())


def _within(factor: float) -> float:
    return min(_MOST, max(_LEAST, factor))
