"""Which of several links is taken: the most preferred that works. Pure.

A link that fails is left after half a second; a better one that came back is taken again once it has been
good for five. Where none works, nothing is gained by a change, so there is none.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from simple_ros.errors import ConfigError

__all__ = ["LinkHealth", "RouteJudge", "routes_of"]


def routes_of(text: str) -> tuple[str, ...]:
    """Links of a list with commas.

    Raises:
        ConfigError: One is there twice.
    """
    found = tuple(word.strip() for word in text.split(",") if word.strip())
    for name in found:
        if found.count(name) > 1:
            raise ConfigError(f"routes {text!r} have {name!r} twice")
    return found


@dataclass(frozen=True, slots=True)
class LinkHealth:
    """How a link was when it was last heard of.

    Attributes:
        quality: 0..1.
        heard_s: When that was.
    """

    quality: float
    heard_s: float


class RouteJudge:
    """Holds the route.

    Args:
        links: Most preferred first, at least one.
        route: To begin with; the most preferred if it is none of them.
        silent_after_s: A link that was not heard of for so long does not work.
        least_quality: The same below this quality.
        margin: A link to come back to must be better by this share.
        leave_after_s: How long the present one must have failed.
        return_after_s: How long a more preferred one must have been good.

    Attributes:
        route: The link to take.
        reason: Why.
    """

    def __init__(
        self,
        links: Sequence[str],
        route: str = "",
        *,
        silent_after_s: float = 2.0,
        least_quality: float = 0.25,
        margin: float = 0.2,
        leave_after_s: float = 0.5,
        return_after_s: float = 5.0,
    ) -> None:
        if not links:
            raise ConfigError("a route needs a link")
        self.links = tuple(links)
        self.route = route if route in self.links else self.links[0]
        self.reason = "to begin with"
        self._silent_after_s = silent_after_s
        self._least = least_quality
        self._margin = margin
        self._leave_after_s = leave_after_s
        self._return_after_s = return_after_s
        self._failing_since_s: float | None = None
        self._good_since_s: dict[str, float] = {}

    def update(self, known: Mapping[str, LinkHealth], now_s: float) -> bool:
        """Judge again; whether the route changed.

        Args:
            known: Links that were heard of; there may be others among them.
            now_s: When.
        """
        self._note_good(known, now_s)
        trouble = self._trouble(self.route, known, now_s)
        if not trouble:
            self._failing_since_s = None
            return self._back(now_s)
        if self._failing_since_s is None:
            self._failing_since_s = now_s
        if now_s - self._failing_since_s < self._leave_after_s:
            return False
        for link in self.links:
            if not self._trouble(link, known, now_s):
                return self._take(link, f"{self.route} {trouble}")
        return False

    def _trouble(self, link: str, known: Mapping[str, LinkHealth], now_s: float) -> str:
        health = known.get(link)
        if health is None:
            return "was never heard of"
        silent_s = now_s - health.heard_s
        if silent_s > self._silent_after_s:
            return f"is silent for {silent_s:.1f} s"
        if health.quality < self._least:
            return f"has quality {health.quality:.2f}"
        return ""

    def _note_good(self, known: Mapping[str, LinkHealth], now_s: float) -> None:
        for link in self.links:
            health = known.get(link)
            is_fresh = health is not None and now_s - health.heard_s <= self._silent_after_s
            if (
                health is not None
                and is_fresh
                and health.quality >= self._least * (1 + self._margin)
            ):
                self._good_since_s.setdefault(link, now_s)
            else:
                self._good_since_s.pop(link, None)

    def _back(self, now_s: float) -> bool:
        for link in self.links[: self.links.index(self.route)]:
            since_s = self._good_since_s.get(link)
            if since_s is not None and now_s - since_s >= self._return_after_s:
                return self._take(link, f"{link} is good again")
        return False

    def _take(self, link: str, reason: str) -> bool:
        self.route, self.reason = link, reason
        self._failing_since_s = None
        return True
