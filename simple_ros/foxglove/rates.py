"""Limits that users set per topic: how often, and how many may wait. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

from simple_ros.errors import ConfigError
from simple_ros.names import canonical

__all__ = ["RateLimit", "TopicLimits"]

_SLACK = 0.1


class RateLimit:
    """Lets messages through so many times a second.

    The phase is kept, so that of a steady flow exactly the wanted share passes; a message that is
    early by a tenth of the period counts as in time.

    Args:
        hz: How often, more than 0.
    """

    __slots__ = ("_due", "_period_s")

    def __init__(self, hz: float) -> None:
        self._period_s = 1.0 / hz
        self._due = -math.inf

    def passes(self, now: float) -> bool:
        """Whether a message of now, in monotonic seconds, is sent."""
        if now < self._due - _SLACK * self._period_s:
            return False
        keeps_phase = now - self._due < self._period_s
        self._due = (self._due if keeps_phase else now) + self._period_s
        return True


@dataclass(frozen=True, slots=True)
class TopicLimits:
    """``TOPIC=NUMBER`` by glob patterns; of several that fit the last counts.

    Attributes:
        rules: Patterns without leading slash, and their numbers.
    """

    rules: tuple[tuple[str, float], ...] = ()

    @classmethod
    def made(cls, texts: Sequence[str], option: str, *, whole: bool = False) -> TopicLimits:
        """Limits as a user writes them.

        Args:
            texts: ``PATTERN=NUMBER`` each.
            option: Where they were written, for the error.
            whole: Whether the number must be an integer of 1 or more.

        Raises:
            ConfigError: A text is none of these.
        """
        rules = []
        for text in texts:
            pattern, there, number = text.rpartition("=")
            try:
                value = float(number)
            except ValueError:
                value = math.nan
            valid = value > 0 and math.isfinite(value) and (not whole or value.is_integer())
            if not (there and pattern and valid):
                wanted = "a whole number" if whole else "a number"
                raise ConfigError(f"{option} wants TOPIC={wanted} above 0, not {text!r}")
            rules.append((canonical(pattern), value))
        return cls(tuple(rules))

    def of(self, topic: str) -> float | None:
        """The limit of a topic, with or without leading slash; None if there is none."""
        name = canonical(topic)
        found = [value for pattern, value in self.rules if fnmatchcase(name, pattern)]
        return found[-1] if found else None
