"""What is recorded, when it is made safe and when a new file begins. Pure: time is an argument."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field

from simple_ros.errors import ConfigError
from simple_ros.names import canonical, topic_name

__all__ = ["Cadence", "LatchedHistory", "SplitRule", "TopicSelection", "pattern_of"]


def pattern_of(text: str | None, what: str) -> re.Pattern[str] | None:
    """A regular expression.

    Raises:
        ConfigError: It is none; the message names ``what``.
    """
    if text is None:
        return None
    try:
        return re.compile(text)
    except re.error as error:
        raise ConfigError(f"{what} {text!r} is no regular expression: {error}") from None


@dataclass(frozen=True)
class TopicSelection:
    """Which topics are meant.

    A regular expression fits if it is found somewhere in the name, written with or without its leading
    slash; ``^`` and ``$`` hold it to the ends.

    Attributes:
        names: These topics, in canonical form.
        every: All topics.
        pattern: Topics whose name fits.
        exclude: Never topics whose name fits, unless they are in ``names``.
    """

    names: frozenset[str] = frozenset()
    every: bool = False
    pattern: re.Pattern[str] | None = None
    exclude: re.Pattern[str] | None = None

    @classmethod
    def made(
        cls,
        names: Iterable[str] = (),
        *,
        every: bool = False,
        pattern: str | None = None,
        exclude: str | None = None,
    ) -> TopicSelection:
        """A selection as a user writes it.

        Raises:
            InvalidName: A name breaks the rules.
            ConfigError: A pattern is no regular expression.
        """
        return cls(
            frozenset(map(topic_name, names)),
            every,
            pattern_of(pattern, "the pattern"),
            pattern_of(exclude, "the pattern of what is left out"),
        )

    @property
    def is_empty(self) -> bool:
        """Whether nothing at all is meant."""
        return not (self.names or self.every or self.pattern)

    def wants(self, topic: str) -> bool:
        """Whether a topic is meant."""
        name = canonical(topic)
        if name in self.names:
            return True
        if self.exclude is not None and _fits(self.exclude, name):
            return False
        return self.every or (self.pattern is not None and _fits(self.pattern, name))


def _fits(pattern: re.Pattern[str], name: str) -> bool:
    return pattern.search(name) is not None or pattern.search(f"/{name}") is not None


@dataclass(frozen=True)
class SplitRule:
    """When a new file begins.

    Attributes:
        max_bytes: The file is that large; None for no limit.
        max_duration_s: Messages of so many seconds are in it; None for no limit.
    """

    max_bytes: int | None = None
    max_duration_s: float | None = None

    @property
    def is_on(self) -> bool:
        """Whether there is more than one file to expect."""
        return self.max_bytes is not None or self.max_duration_s is not None

    def is_due(self, size_bytes: int, first_ns: int, now_ns: int) -> bool:
        """Whether a message of now belongs into the next file.

        Args:
            size_bytes: Size of the present file.
            first_ns: Time of its first message.
            now_ns: Time of the message.
        """
        if self.max_bytes is not None and size_bytes >= self.max_bytes:
            return True
        duration_s = self.max_duration_s
        return duration_s is not None and now_ns - first_ns >= duration_s * 1e9


class Cadence:
    """Something to do every so often, no more than once for a time that was missed.

    Args:
        period_s: Seconds between two times.
        now: Monotonic seconds.
    """

    def __init__(self, period_s: float, now: float) -> None:
        self._period_s = period_s
        self.due = now + period_s

    def is_due(self, now: float) -> bool:
        """Whether it is time; if so, the next time is set."""
        if now < self.due:
            return False
        self.due = max(self.due + self._period_s, now)
        return True


@dataclass
class LatchedHistory:
    """What a late joiner of a latched topic has to be given.

    Several publishers of one topic, each with a message of its own that counts (``tf_static``), cannot
    be told apart here, so the last messages that differ are kept, not only the last one.

    Attributes:
        max_messages: How many are kept at most.
        max_bytes: How many bytes; the last message is kept whatever its size.
    """

    max_messages: int = 64
    max_bytes: int = 1024 * 1024
    _kept: deque[tuple[bytes, int]] = field(default_factory=deque)
    _size_bytes: int = 0

    def add(self, payload: bytes, stamp_ns: int) -> None:
        """A message has come."""
        self._kept = deque(entry for entry in self._kept if entry[0] != payload)
        self._kept.append((payload, stamp_ns))
        self._size_bytes = sum(len(kept) for kept, _ in self._kept)
        while len(self._kept) > 1 and (
            len(self._kept) > self.max_messages or self._size_bytes > self.max_bytes
        ):
            self._size_bytes -= len(self._kept.popleft()[0])

    def messages(self) -> tuple[tuple[bytes, int], ...]:
        """Payloads and the times they came at, oldest first."""
        return tuple(self._kept)
