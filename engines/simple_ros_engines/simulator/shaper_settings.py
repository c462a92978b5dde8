"""What a simulated link does to messages, as values. SIMULATED; pure.

A *link* joins one site (a robot) by radio to everything else; every other site is wired and costs nothing. All
links share the resource blocks of one carrier in each direction.
"""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

from simple_ros.errors import ConfigError
from simple_ros_engines.radio.carrier import Carrier

__all__ = [
    "DIRECTIONS",
    "EVERYTHING",
    "Conditions",
    "LinkSettings",
    "Overflow",
    "ShaperSettings",
    "TopicClass",
    "class_of",
]

DIRECTIONS = ("up", "down")
"""From the link's site to others, and from others to it."""


class Overflow(Enum):
    """What happens to a message that does not fit its queue."""

    DROP = "drop"
    HOLD = "hold"


@dataclass(frozen=True, slots=True)
class TopicClass:
    """Topics that are queued together.

    Attributes:
        name: For statistics.
        topics: Patterns with ``*`` and ``?``; a name without leading slash fits either way.
        priority: Higher is served first, in the middle of a lower one's message too.
        queue_bytes: Most that waits in each direction of a link.
        deadline_s: Older on arrival is late; None: nothing is.
        discard_late: Whether what is too old before its sending begins is given up.
        overflow: Whether a message for which there is no room is dropped, or its publisher held back as by TCP.
        dscp: Connections with one of these code points belong here, whatever their topic.
    """

    name: str
    topics: tuple[str, ...] = ("*",)
    priority: int = 3
    queue_bytes: int = 1_000_000
    deadline_s: float | None = None
    discard_late: bool = False
    overflow: Overflow = Overflow.DROP
    dscp: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Conditions:
    """One direction of a link at one time.

    Attributes:
        rate_bps: With all blocks of the carrier.
        delay_s: Of every message.
        jitter_s: Mean of what is added to it by chance (exponential, at most five times this).
        loss: Share of messages lost on the air.
        min_share: Share of the blocks it gets whatever others want.
        max_share: Share it never exceeds.
    """

    rate_bps: float = math.inf
    delay_s: float = 0.0
    jitter_s: float = 0.0
    loss: float = 0.0
    min_share: float = 0.0
    max_share: float = 1.0

    def __post_init__(self) -> None:
        if not self.rate_bps >= 0:
            raise ConfigError(f"rate_bps is {self.rate_bps}, must be 0 or more")
        if not (0 <= self.delay_s < 60 and 0 <= self.jitter_s < 60):
            raise ConfigError(f"delay {self.delay_s} s, jitter {self.jitter_s} s: 0 to 60 s")
        if not 0 <= self.loss <= 1:
            raise ConfigError(f"loss is {self.loss}, must lie between 0 and 1")
        if not 0 <= self.min_share <= self.max_share <= 1:
            raise ConfigError(
                f"shares {self.min_share}..{self.max_share} need 0 <= min <= max <= 1"
            )


@dataclass(frozen=True, slots=True)
class LinkSettings:
    """One link.

    Attributes:
        name: Name of its site.
        up: From the site.
        down: To the site.
        rnti: Its number in the radio network, if it shall have one.
        channel: What drives the rate; empty: the rate stays as it is. See `shaper_channel`.
        pose_topic: Topic (PoseStamped) that tells where its device is; empty: its route does.
    """

    name: str
    up: Conditions = field(default_factory=Conditions)
    down: Conditions = field(default_factory=Conditions)
    rnti: int | None = None
    channel: Mapping[str, Any] = field(default_factory=dict)
    pose_topic: str = ""


EVERYTHING = TopicClass("all")


@dataclass(frozen=True, slots=True)
class ShaperSettings:
    """All of a shaper.

    Attributes:
        links: By site name.
        classes: In order; the first that fits takes a topic.
        carrier: Shared by all links, each direction the same.
        seed: Of everything that happens by chance.
        listen: Address, ``host:port``.
        rrm_policy_file: Slice policy to obey (`policy_shares`); empty: none.
    """

    links: Mapping[str, LinkSettings] = field(default_factory=dict)
    classes: tuple[TopicClass, ...] = (EVERYTHING,)
    carrier: Carrier = field(default_factory=Carrier)
    seed: int = 1
    listen: str = "127.0.0.1:7310"
    rrm_policy_file: str = ""


def class_of(classes: Sequence[TopicClass], topic: str, dscp: int | None = None) -> int:
    """Index of the class a topic belongs to; the last one takes what fits none.

    Args:
        classes: In order.
        topic: Name.
        dscp: Code point of the connection; None if unknown. It goes before the name.
    """
    for index, item in enumerate(classes):
        if dscp and dscp in item.dscp:
            return index
    plain = topic.lstrip("/")
    for index, item in enumerate(classes):
        if any(fnmatch.fnmatchcase(plain, pattern.lstrip("/")) for pattern in item.topics):
            return index
    return len(classes) - 1
