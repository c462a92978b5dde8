"""Quality of service: what a publisher offers, what a subscription requests, and whether they fit.

Policies and their compatibility follow ROS 2 (REP 2003 and the DDS "requested versus offered"
model): a publisher must offer at least what a subscription requests. A peer that names no profile
(any C++ simple_ros node) fits with everything.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, Literal

from simple_ros.errors import ConfigError

__all__ = [
    "DEFAULT",
    "LATCHED",
    "SENSOR_DATA",
    "Durability",
    "Incompatibility",
    "Liveliness",
    "Overflow",
    "QosProfile",
    "Reliability",
    "incompatibilities",
    "strictest",
    "weakest",
]

Overflow = Literal["drop", "block"]

MAX_DEPTH = 2**31 - 1
"""Largest depth that travels."""


class Reliability(Enum):
    """What happens to messages a link cannot carry at once."""

    BEST_EFFORT = "best_effort"
    """Only the newest matter: what waits for a link is given up when that link breaks."""
    RELIABLE = "reliable"
    """What waits for a link is kept for the next one to the same subscriber."""


class Durability(Enum):
    """What a subscriber gets that joins after a message was published."""

    VOLATILE = "volatile"
    TRANSIENT_LOCAL = "transient_local"
    """Latched: the publisher keeps its last message and sends it to late joiners."""


class Liveliness(Enum):
    """What counts as a sign of life of a publisher."""

    AUTOMATIC = "automatic"
    """Its connection: lost when the connection ends or the peer host no longer answers."""
    MANUAL_BY_TOPIC = "manual_by_topic"
    """A message: lost when none came for ``liveliness_lease_s`` (without a lease nothing is)."""


_RELIABILITY_RANK = {Reliability.BEST_EFFORT: 0, Reliability.RELIABLE: 1}
_DURABILITY_RANK = {Durability.VOLATILE: 0, Durability.TRANSIENT_LOCAL: 1}
_LIVELINESS_RANK = {Liveliness.AUTOMATIC: 0, Liveliness.MANUAL_BY_TOPIC: 1}


@dataclass(frozen=True, slots=True)
class QosProfile:
    """One side's quality of service on one topic.

    Attributes:
        depth: Messages that may wait, per link at a publisher and per subscription at a subscriber.
        reliability: See `Reliability`.
        durability: See `Durability`.
        deadline_s: Longest expected time between two messages, in seconds; None for no expectation.
        lifespan_s: Age in seconds after which a waiting message is no longer worth sending or
            delivering; None for never.
        liveliness: See `Liveliness`.
        liveliness_lease_s: Seconds without a sign of life after which a publisher counts as lost;
            None for the transport's own detection.
        overflow: ``"drop"`` never waits; ``"block"`` makes a publisher wait for the slowest
            reliable subscriber (``await publisher.publish_async(msg)``).
        max_bytes: Bytes that may wait per link or subscription; at least one message always may.

    Raises:
        ConfigError: A value is out of range.
    """

    depth: int = 100
    reliability: Reliability = Reliability.RELIABLE
    durability: Durability = Durability.VOLATILE
    deadline_s: float | None = None
    lifespan_s: float | None = None
    liveliness: Liveliness = Liveliness.AUTOMATIC
    liveliness_lease_s: float | None = None
    overflow: Overflow = "drop"
    max_bytes: int = 64 * 1024 * 1024

    def __post_init__(self) -> None:
        if not 1 <= self.depth <= MAX_DEPTH:
            raise ConfigError(f"QoS depth must be 1 to {MAX_DEPTH}, not {self.depth}")
        if self.max_bytes < 1:
            raise ConfigError(f"QoS max_bytes must be at least 1, not {self.max_bytes}")
        for field in ("deadline_s", "lifespan_s", "liveliness_lease_s"):
            value = getattr(self, field)
            if value is not None and not (value > 0 and math.isfinite(value)):
                raise ConfigError(
                    f"QoS {field} must be a positive number of seconds, not {value!r}"
                )
        for name, kind in _ENUM_FIELDS.items():
            if not isinstance(getattr(self, name), kind):
                raise ConfigError(f"QoS {name} must be a {kind.__name__}")
        if self.overflow not in ("drop", "block"):
            raise ConfigError(f"QoS overflow must be 'drop' or 'block', not {self.overflow!r}")

    def replace(self, **changes: Any) -> QosProfile:
        """A copy with some policies changed."""
        return replace(self, **changes)


_ENUM_FIELDS: dict[str, type[Enum]] = {
    "reliability": Reliability,
    "durability": Durability,
    "liveliness": Liveliness,
}

DEFAULT = QosProfile()
"""Reliable, volatile, 100 deep."""
SENSOR_DATA = QosProfile(depth=5, reliability=Reliability.BEST_EFFORT)
"""For streams of which only the newest sample matters."""
LATCHED = QosProfile(depth=1, durability=Durability.TRANSIENT_LOCAL)
"""For state that changes rarely, such as a map: late joiners get the last message."""


@dataclass(frozen=True, slots=True)
class Incompatibility:
    """One policy in which an offer falls short of a request."""

    policy: str
    offered: str
    requested: str

    def __str__(self) -> str:
        return f"{self.policy} offered {self.offered}, requested {self.requested}"


def incompatibilities(offered: QosProfile, requested: QosProfile) -> tuple[Incompatibility, ...]:
    """The policies in which ``offered`` (publisher) falls short of ``requested`` (subscription).

    Empty when they fit. Depth, lifespan, overflow and byte limits never conflict.
    """
    found = []
    for policy, ranks in (
        ("reliability", _RELIABILITY_RANK),
        ("durability", _DURABILITY_RANK),
        ("liveliness", _LIVELINESS_RANK),
    ):
        offer, request = getattr(offered, policy), getattr(requested, policy)
        if ranks[offer] < ranks[request]:
            found.append(Incompatibility(policy, offer.value, request.value))
    for policy in ("deadline_s", "liveliness_lease_s"):
        offer, request = getattr(offered, policy), getattr(requested, policy)
        if request is not None and (offer is None or offer > request):
            shown = "none" if offer is None else f"{offer:g} s"
            found.append(Incompatibility(policy.removesuffix("_s"), shown, f"{request:g} s"))
    return tuple(found)


def strictest(profiles: Sequence[QosProfile]) -> QosProfile:
    """What several subscriptions of one node to one topic request together.

    They share a link, so each policy is the most demanding of them all.
    """
    return _merged(profiles, max, min)


def weakest(profiles: Sequence[QosProfile]) -> QosProfile:
    """What several publishers of one node on one topic offer together: the least of each policy."""
    return _merged(profiles, min, _longest)


def _longest(values: Sequence[float | None]) -> float | None:
    return None if None in values else max(value for value in values if value is not None)


def _merged(
    profiles: Sequence[QosProfile],
    pick: Callable[..., Any],
    pick_period: Callable[[Sequence[Any]], float | None],
) -> QosProfile:
    def period(field: str) -> float | None:
        values = [getattr(profile, field) for profile in profiles]
        if pick is max:
            values = [value for value in values if value is not None]
        return pick_period(values) if values else None

    first = profiles[0]
    if all(profile == first for profile in profiles):
        return first
    return first.replace(
        depth=max(profile.depth for profile in profiles),
        reliability=pick((p.reliability for p in profiles), key=_RELIABILITY_RANK.__getitem__),
        durability=pick((p.durability for p in profiles), key=_DURABILITY_RANK.__getitem__),
        liveliness=pick((p.liveliness for p in profiles), key=_LIVELINESS_RANK.__getitem__),
        deadline_s=period("deadline_s"),
        liveliness_lease_s=period("liveliness_lease_s"),
    )
