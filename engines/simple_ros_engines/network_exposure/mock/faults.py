"""What may be wrong with the mock network on request, and how that and its settings are changed: pure."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

from simple_ros_engines.network_exposure.mock.core import MockSettings

__all__ = ["Faults", "sorted_out"]

_LEAST = {"status_count": -1}
_STATUS = range(100, 600)


@dataclass(slots=True)
class Faults:
    """What is wrong now.

    Attributes:
        is_down: Connections are closed without an answer.
        delay_s: Before each answer.
        status: Answered instead of the real answer; 0 for none.
        status_count: How often; -1 for always.
        malformed: Answers with a body have JSON that is none.
        loses_notifications: None is sent.
        retry_after_s: Said with 429 and 503.
    """

    is_down: bool = False
    delay_s: float = 0.0
    status: int = 0
    status_count: int = -1
    malformed: bool = False
    loses_notifications: bool = False
    retry_after_s: int = 0

    def take_status(self) -> int:
        """The status to answer with instead; 0 for none."""
        if not self.status or self.status_count == 0:
            return 0
        if self.status_count > 0:
            self.status_count -= 1
        return self.status


def sorted_out(changes: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Changes of settings, and those of faults.

    Raises:
        ValueError: A name or a value is wrong.
    """
    own: tuple[dict[str, Any], ...] = ({}, {})
    for into, kind in zip(own, (MockSettings, Faults), strict=True):
        for field in fields(kind):
            if field.name in changes:
                _check(field.name, field.default, changes[field.name])
                into[field.name] = changes[field.name]
    unknown = sorted(changes.keys() - own[0].keys() - own[1].keys())
    if unknown:
        known = ", ".join(field.name for kind in (MockSettings, Faults) for field in fields(kind))
        raise ValueError(f"there is nothing to set {', '.join(unknown)}: only {known}")
    return own[0], own[1]


def _check(name: str, default: object, value: object) -> None:
    if isinstance(default, bool) or isinstance(value, bool):
        if type(default) is not type(value):
            raise ValueError(f"{name} cannot be {value!r}")
        return
    kind = int if isinstance(default, int) else (int, float)
    if not isinstance(value, kind) or not math.isfinite(value):
        raise ValueError(f"{name} cannot be {value!r}")
    if value < _LEAST.get(name, 0) or (name == "status" and value and value not in _STATUS):
        raise ValueError(f"{name} cannot be {value!r}: it is out of range")
