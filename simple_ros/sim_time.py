"""What a node knows of simulated time: pure state, fed with the stamps of ``/clock``."""

from __future__ import annotations

from enum import Enum

from simple_ros.errors import ConfigError

__all__ = ["ClockChange", "SimTime", "wants_sim_time"]

_YES = frozenset(("1", "true", "yes", "on"))
_NO = frozenset(("", "0", "false", "no", "off"))


class ClockChange(Enum):
    """What happened to a node's clock."""

    TICK = "tick"
    """Simulated time went on, or was repeated."""
    STARTED = "started"
    """The first simulated time came."""
    JUMPED_BACK = "jumped back"
    """Simulated time went back."""
    SWITCHED = "switched"
    """Simulated time was switched on or off."""

    @property
    def breaks(self) -> bool:
        """Whether times of before mean nothing any more."""
        return self in (ClockChange.JUMPED_BACK, ClockChange.SWITCHED)


class SimTime:
    """The last time that came.

    Attributes:
        nanoseconds: It; 0 before the first, as in ROS.
    """

    __slots__ = ("_origin", "nanoseconds")

    def __init__(self) -> None:
        self.nanoseconds = 0
        self._origin: int | None = None

    @property
    def has_come(self) -> bool:
        """Whether any time has come."""
        return self._origin is not None

    @property
    def seconds(self) -> float:
        """Seconds since the first time that came; negative before it.

        Small numbers, so that the steps of timers add up without loss.
        """
        return 0.0 if self._origin is None else (self.nanoseconds - self._origin) / 1e9

    def receive(self, nanoseconds: int) -> ClockChange:
        """Take a time."""
        back = nanoseconds < self.nanoseconds
        self.nanoseconds = nanoseconds
        if self._origin is None:
            self._origin = nanoseconds
            return ClockChange.STARTED
        return ClockChange.JUMPED_BACK if back else ClockChange.TICK


def wants_sim_time(setting: str | None, variable: str) -> bool:
    """Whether an environment variable asks for simulated time.

    Raises:
        ConfigError: It says neither yes nor no.
    """
    word = (setting or "").strip().lower()
    if word in _YES or word in _NO:
        return word in _YES
    raise ConfigError(f"{variable} is 1 or 0 (or true, yes, on, false, no, off), not {setting!r}")
