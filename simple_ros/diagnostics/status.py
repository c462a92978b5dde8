"""Building a `DiagnosticStatus`: a level, a line of text, and facts."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

from simple_ros.msg.diagnostic_msgs import DiagnosticStatus, KeyValue

__all__ = ["ERROR", "LEVEL_NAMES", "OK", "STALE", "WARN", "Level", "Status", "level_name", "worst"]

if TYPE_CHECKING:
    Level: TypeAlias = DiagnosticStatus.Level.ValueType
else:
    Level = int

OK: Level = DiagnosticStatus.OK
WARN: Level = DiagnosticStatus.WARN
ERROR: Level = DiagnosticStatus.ERROR
STALE: Level = DiagnosticStatus.STALE

LEVEL_NAMES = ("ok", "warn", "error", "stale")


def level_name(level: int) -> str:
    """The name of a level; a number if it has none."""
    return LEVEL_NAMES[level] if 0 <= level < len(LEVEL_NAMES) else str(level)


def worst(levels: list[Level]) -> Level:
    """The worst of some levels; OK if there are none. Stale counts as worse than an error."""
    return max(levels, default=OK)


class Status:
    """The health of one component, as it is found out.

    Args:
        name: The component.
        hardware_id: The device it is about, if any.

    Attributes:
        level: OK at first.
        message: One line for a person.
    """

    def __init__(self, name: str, hardware_id: str = "") -> None:
        self.name = name
        self.hardware_id = hardware_id
        self.level: Level = OK
        self.message = ""
        self._values: dict[str, str] = {}

    def summary(self, level: Level, message: str) -> None:
        """Say how it is, in place of what was said before."""
        self.level = level
        self.message = message

    def merge_summary(self, level: Level, message: str) -> None:
        """Say one thing more: the worse level counts, and what is not OK is told together."""
        if level > OK and self.level > OK and self.message:
            self.message = f"{self.message}; {message}"
        elif level > self.level or not self.message:
            self.message = message
        self.level = max(level, self.level)

    def add(self, key: str, value: object) -> None:
        """A fact, as text; a number with up to 6 digits. A further one of that key replaces it."""
        self._values[key] = f"{value:.6g}" if isinstance(value, float) else str(value)

    @property
    def values(self) -> dict[str, str]:
        """The facts so far."""
        return dict(self._values)

    def to_message(self) -> DiagnosticStatus:
        """The status as message."""
        return DiagnosticStatus(
            level=self.level,
            name=self.name,
            message=self.message,
            hardware_id=self.hardware_id,
            values=[KeyValue(key=key, value=value) for key, value in self._values.items()],
        )
