"""What an agent turns on its topic: delay, share of messages left out, speed of the process. Pure.

Delays are in times between two messages of the topic, as nothing is left out: half a second is much for a command that
comes each 20 ms and nothing for one that comes each second.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from simple_ros.errors import ConfigError

__all__ = ["DELAYS", "DROPS", "KNOBS", "SPEEDS", "START", "STAY", "Action", "Setting"]

DELAYS = (0.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0)
"""Hold each message back for so many intervals. One alone would change no request: the mapper takes it for granted."""
DROPS = (0, 256, 128, 64, 32, 16, 8, 4, 2)
"""Leave out each n-th; 0 leaves out none."""
SPEEDS = (0.25, 0.5, 1.0, 2.0)
KNOBS = ("delay", "drop", "speed")
_SETS = (DELAYS, DROPS, SPEEDS)

Action = tuple[int, int, int]
"""-1, 0 or 1 for each knob: one notch down, none, one up."""
STAY: Action = (0, 0, 0)


@dataclass(frozen=True, slots=True)
class Setting:
    """Where the knobs of a topic are: indexes into their value sets.

    Raises:
        ConfigError: There is no such value.
    """

    delay: int = 0
    drop: int = 0
    speed: int = 2

    def __post_init__(self) -> None:
        for name, values, index in zip(KNOBS, _SETS, self.notches, strict=True):
            if not 0 <= index < len(values):
                raise ConfigError(f"{name} has values 0 to {len(values) - 1}, not {index}")

    @property
    def notches(self) -> tuple[int, int, int]:
        """The indexes."""
        return self.delay, self.drop, self.speed

    @property
    def held_messages(self) -> float:
        """Each message is held for so many intervals."""
        return DELAYS[self.delay]

    def delay_ms(self, rate_hz: float) -> float:
        """The same in ms, for a topic that has so many messages a second when nothing is left out."""
        return 1000 * self.held_messages / rate_hz if rate_hz > 0 else 0.0

    @property
    def drop_every_nth(self) -> int:
        """Each so-manyth message is left out; 0 for none."""
        return DROPS[self.drop]

    @property
    def drop_rate(self) -> float:
        """Share of messages left out."""
        return 1 / self.drop_every_nth if self.drop_every_nth else 0.0

    @property
    def speed_factor(self) -> float:
        """Of the process's own speed."""
        return SPEEDS[self.speed]

    def moved(self, action: Sequence[int]) -> Setting:
        """One notch further, no further than the ends.

        Raises:
            ConfigError: It is no action.
        """
        if len(action) != len(KNOBS) or any(step not in (-1, 0, 1) for step in action):
            raise ConfigError(f"an action is three of -1, 0 and 1, not {tuple(action)!r}")
        notches = (
            min(len(values) - 1, max(0, index + int(step)))
            for values, index, step in zip(_SETS, self.notches, action, strict=True)
        )
        return Setting(*notches)

    def towards(self, other: Setting) -> Action:
        """The action that brings it nearer to another."""
        steps = [
            (there > here) - (there < here)
            for here, there in zip(self.notches, other.notches, strict=True)
        ]
        return steps[0], steps[1], steps[2]

    def is_as_bad_as(self, harmful: Setting) -> bool:
        """Whether a topic stands no better than where it did harm."""
        if harmful.speed < START.speed:
            # Who was too slow says nothing about who is not.
            return self == harmful
        return all(one >= bad for one, bad in zip(self.notches, harmful.notches, strict=True))


START = Setting()
"""Nothing is made worse, and the process has its own speed."""
