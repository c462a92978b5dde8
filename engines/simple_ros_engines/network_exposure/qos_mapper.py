"""From what a topic needs to a QoS class of the network. Pure.

A class serves a flow if it is at least as good in every respect: its delay budget and its error rate are no larger than
required, its burst volume (where it has one) no smaller. Of those that do, the one that costs the network least comes
first: the longest delay, then the highest error rate, then the least important priority, then the smallest burst volume. The
next ones are its alternatives, tighter and tighter.

If none does, the one that misses least is taken and said to be unmet: misses are compared by the sum of the logarithms
of the factors by which delay, error rate and burst are missed.
"""

from __future__ import annotations

import math
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from enum import Enum

from simple_ros_engines.network_exposure.qci import (
    FIVE_G_ONLY,
    QCI,
    RESERVED,
    QosClass,
    ResourceType,
)

__all__ = [
    "MapperSettings",
    "Mode",
    "Requirement",
    "Selection",
    "select",
]

MAX_ALTERNATIVES = 3
_SLACK = 1 + 1e-9


class Mode(Enum):
    """When the network is asked anew."""

    STATIC = "static"
    """Once for each flow."""
    DYNAMIC = "dynamic"
    """When what the flow needs has changed."""
    AI = "ai"
    """As dynamic, and advice on a topic goes before what was measured."""


@dataclass(frozen=True, slots=True)
class Requirement:
    """What a flow needs of the network.

    Attributes:
        resource: Whether a bit rate is to be reserved.
        delay_ms: Longest delay.
        error_rate: Largest share of lost packets.
        burst_bytes: Most bytes within one such delay.
        bit_rate: bit/s, on average.
    """

    resource: ResourceType
    delay_ms: float
    error_rate: float
    burst_bytes: int = 0
    bit_rate: float = 0.0


@dataclass(frozen=True, slots=True)
class MapperSettings:
    """What the mapper may choose from, and how it judges.

    Attributes:
        five_g: Whether classes that only 5G has may be taken.
        authorised: Mission-critical and IMS classes that may be taken.
        reliable_error_rate: What a reliable topic requires.
        best_effort_error_rate: What another one does.
        steady: A rate that changes less than by this share from window to window is steady.
        unsteady: A steady one becomes unsteady when it changes more.
        min_window_s: Shorter windows say nothing.
    """

    five_g: bool = False
    authorised: AbstractSet[int] = frozenset()
    reliable_error_rate: float = 1e-5
    best_effort_error_rate: float = 1e-2
    steady: float = 0.10
    unsteady: float = 0.20
    min_window_s: float = 2.0


@dataclass(frozen=True, slots=True)
class Selection:
    """What to ask the network for.

    Attributes:
        chosen: The class.
        alternatives: Others that serve, in order; at most three.
        requirement: What it was chosen for.
        is_unmet: Whether no class serves; ``chosen`` misses least.
        misses: What is missed, in words.
        warnings: What is odd about the topic's settings.
    """

    chosen: QosClass
    alternatives: tuple[QosClass, ...]
    requirement: Requirement
    is_unmet: bool = False
    misses: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def qci(self) -> int:
        """Number of the class."""
        return self.chosen.qci


def _order(row: QosClass) -> tuple[float, ...]:
    burst = row.burst_bytes if row.burst_bytes is not None else 0
    return (-row.delay_ms, -row.error_rate, -row.priority, burst, row.qci)


_ORDERED = {
    kind: tuple(sorted((row for row in QCI.values() if row.resource is kind), key=_order))
    for kind in ResourceType
}


def select(requirement: Requirement, settings: MapperSettings | None = None) -> Selection:
    """The class for a requirement, and its alternatives."""
    settings = settings or MapperSettings()
    rows = [row for row in _ORDERED[requirement.resource] if _is_allowed(row, settings)]
    serving = [row for row in rows if _serves(row, requirement)]
    if serving:
        return Selection(serving[0], tuple(serving[1 : 1 + MAX_ALTERNATIVES]), requirement)
    best = min(rows, key=lambda row: _miss(row, requirement))
    return Selection(best, (), requirement, True, _misses(best, requirement))


def _is_allowed(row: QosClass, settings: MapperSettings) -> bool:
    if row.qci in RESERVED and row.qci not in settings.authorised:
        return False
    return settings.five_g or row.qci not in FIVE_G_ONLY


def _serves(row: QosClass, wanted: Requirement) -> bool:
    return (
        row.delay_ms <= wanted.delay_ms * _SLACK
        and row.error_rate <= wanted.error_rate * _SLACK
        and (row.burst_bytes is None or row.burst_bytes >= wanted.burst_bytes)
    )


def _factors(row: QosClass, wanted: Requirement) -> tuple[float, float, float]:
    burst = 1.0 if row.burst_bytes is None else wanted.burst_bytes / row.burst_bytes
    return row.delay_ms / wanted.delay_ms, row.error_rate / wanted.error_rate, burst


def _miss(row: QosClass, wanted: Requirement) -> float:
    return sum(math.log(max(1.0, factor)) for factor in _factors(row, wanted))


def _misses(row: QosClass, wanted: Requirement) -> tuple[str, ...]:
    delay, errors, burst = (factor > _SLACK for factor in _factors(row, wanted))
    told = []
    if delay:
        told.append(f"delay {row.delay_ms} ms instead of {wanted.delay_ms:.3g} ms")
    if errors:
        told.append(f"error rate {row.error_rate:g} instead of {wanted.error_rate:g}")
    if burst:
        told.append(f"bursts of {row.burst_bytes} bytes instead of {wanted.burst_bytes}")
    return tuple(told)
