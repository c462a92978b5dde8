"""Quality of service in the metadata of a channel, so that playback offers what was offered.

``latched`` is ``"true"`` or ``"false"``; ``qos`` is a JSON object with the fields of `QosProfile` that
travel. Pure.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from simple_ros.errors import ConfigError
from simple_ros.qos import DEFAULT, LATCHED, Durability, Liveliness, QosProfile, Reliability

__all__ = ["metadata_of", "profile_in"]

_NUMBERS = ("deadline_s", "lifespan_s", "liveliness_lease_s")


def metadata_of(profile: QosProfile) -> dict[str, str]:
    """What a channel's metadata says of its publishers' profile."""
    facts: dict[str, Any] = {
        "depth": profile.depth,
        "reliability": profile.reliability.value,
        "durability": profile.durability.value,
        "liveliness": profile.liveliness.value,
    }
    facts |= {name: value for name in _NUMBERS if (value := getattr(profile, name)) is not None}
    latched = profile.durability is Durability.TRANSIENT_LOCAL
    return {"latched": "true" if latched else "false", "qos": json.dumps(facts)}


def profile_in(metadata: Mapping[str, str]) -> QosProfile:
    """The profile to play a channel with; what is missing or makes no sense is the default."""
    plain = LATCHED if metadata.get("latched") == "true" else DEFAULT
    try:
        facts = json.loads(metadata.get("qos", "{}"))
        if not isinstance(facts, dict):
            return plain
        return plain.replace(
            depth=int(facts.get("depth", plain.depth)),
            reliability=Reliability(facts.get("reliability", plain.reliability.value)),
            durability=Durability(facts.get("durability", plain.durability.value)),
            liveliness=Liveliness(facts.get("liveliness", plain.liveliness.value)),
            **{name: float(facts[name]) for name in _NUMBERS if name in facts},
        )
    except (ConfigError, TypeError, ValueError):
        return plain
