"""The throttle: a topic made worse on purpose, to learn how much of its quality is needed. Pure."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Generic, TypeVar

from simple_ros.errors import ConfigError

__all__ = ["Throttle", "ThrottleSettings"]

MAX_DELAY_MESSAGES = 1000
MAX_DELAY_MS = 60_000.0
_MOST_WAITING = 10_000
Item = TypeVar("Item")


@dataclass(frozen=True, slots=True)
class ThrottleSettings:
    """What it does to messages.

    Attributes:
        drop_every_nth: Leave out each n-th message; 0 leaves out none, 1 all.
        delay_messages: Hold so many back: each goes when so many newer ones have come.
        delay_ms: Hold each for so long.

    Raises:
        ConfigError: A number is out of range.
    """

    drop_every_nth: int = 0
    delay_messages: int = 0
    delay_ms: float = 0.0

    def __post_init__(self) -> None:
        if self.drop_every_nth < 0:
            raise ConfigError(f"drop_every_nth must not be negative: {self.drop_every_nth}")
        if not 0 <= self.delay_messages <= MAX_DELAY_MESSAGES:
            raise ConfigError(
                f"message_delay must be 0 to {MAX_DELAY_MESSAGES}, not {self.delay_messages}"
            )
        if not 0 <= self.delay_ms <= MAX_DELAY_MS:
            raise ConfigError(f"delay_ms must be 0 to {MAX_DELAY_MS:g}, not {self.delay_ms:g}")

    @property
    def drop_rate(self) -> float:
        """Share of messages left out."""
        return 1 / self.drop_every_nth if self.drop_every_nth else 0.0


class Throttle(Generic[Item]):
    """Decides which messages go, and when. Order is kept.

    Attributes:
        settings: May be replaced at any time; what waits goes by the new ones.
        ends_s: When it ends by itself, because whoever asked for it has not said so again; None if it does not.
        dropped: Messages left out on purpose.
        overflowed: Messages left out because too many waited.
    """

    def __init__(self, settings: ThrottleSettings | None = None) -> None:
        self.settings = settings or ThrottleSettings()
        self.ends_s: float | None = None
        self.dropped = 0
        self.overflowed = 0
        self._counted = 0
        self._held: deque[tuple[float, Item]] = deque()

    @property
    def held(self) -> int:
        """Messages that wait."""
        return len(self._held)

    def ask(self, settings: ThrottleSettings, now_s: float, valid_s: float = 0.0) -> None:
        """Work so from now on, for ``valid_s`` seconds unless it is asked again; 0 for good.

        Raises:
            ConfigError: The time is no number of seconds.
        """
        if not 0 <= valid_s < math.inf:
            raise ConfigError(f"valid_s must be a number of seconds, not {valid_s:g}")
        self.settings = settings
        is_none = settings == ThrottleSettings()
        self.ends_s = None if is_none or valid_s == 0 else now_s + valid_s

    def lapse(self, now_s: float) -> bool:
        """End it if its time is over; whether it was."""
        if self.ends_s is None or now_s < self.ends_s:
            return False
        self.ask(ThrottleSettings(), now_s)
        return True

    def put(self, item: Item, now_s: float) -> list[Item]:
        """A message came; those that go now."""
        settings = self.settings
        if settings.drop_every_nth:
            self._counted += 1
            if self._counted % settings.drop_every_nth == 0:
                self.dropped += 1
                return self.due(now_s)
        if not (settings.delay_messages or settings.delay_ms or self._held):
            return [item]
        self._held.append((now_s, item))
        if len(self._held) > _MOST_WAITING:
            self._held.popleft()
            self.overflowed += 1
        return self.due(now_s)

    def due(self, now_s: float) -> list[Item]:
        """Messages that have waited long enough."""
        settings, held = self.settings, self._held
        ready: list[Item] = []
        while (
            len(held) > settings.delay_messages
            and now_s - held[0][0] >= settings.delay_ms / 1000 - 1e-9
        ):
            ready.append(held.popleft()[1])
        return ready

    def next_due_s(self) -> float | None:
        """When `due` will have something, if nothing more comes; None if it will not."""
        if len(self._held) <= self.settings.delay_messages:
            return None
        return self._held[0][0] + self.settings.delay_ms / 1000
