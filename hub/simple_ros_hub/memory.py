"""What a hub knows that a later one cannot find out. Pure."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, TypeVar

__all__ = ["Memory"]

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Memory:
    """Facts.

    Attributes:
        hub: Process of the hub that wrote them; 0 if it ended in order.
        pids: Processes of components that ran, by name.
        stopped: Components that somebody stopped by hand.
        present: Conditions that were told and not over.
        level: Of degradation.
        policy: The policy.
        pinned: Whether somebody chose it.
        base: Parameters of engines without a policy.
        route: The link that was taken.
    """

    hub: int = 0
    pids: Mapping[str, int] = field(default_factory=dict)
    stopped: tuple[str, ...] = ()
    present: tuple[str, ...] = ()
    level: int = 0
    policy: str = ""
    pinned: bool = False
    base: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    route: str = ""

    @classmethod
    def of(cls, facts: Mapping[str, Any]) -> Memory:
        """From what was read; what makes no sense is as if it were not there."""
        return cls(
            _made(int, facts.get("hub"), 0),
            _made(_pids, facts.get("pids"), {}),
            _made(_texts, facts.get("stopped"), ()),
            _made(_texts, facts.get("present"), ()),
            min(3, max(0, _made(int, facts.get("level"), 0))),
            str(facts.get("policy") or ""),
            bool(facts.get("pinned")),
            _made(_groups, facts.get("base"), {}),
            str(facts.get("route") or ""),
        )

    def facts(self) -> dict[str, Any]:
        """To be written."""
        return asdict(self)


def _made(make: Callable[[Any], T], value: Any, otherwise: T) -> T:
    if value is None:
        return otherwise
    try:
        return make(value)
    except (TypeError, ValueError, AttributeError):
        return otherwise


def _pids(value: Any) -> dict[str, int]:
    return {str(name): int(pid) for name, pid in value.items()}


def _texts(value: Any) -> tuple[str, ...]:
    return tuple(map(str, value))


def _groups(value: Any) -> dict[str, dict[str, Any]]:
    return {str(name): dict(group) for name, group in value.items()}
