"""What is said between the Network Layer Service Client and Server: bodies and their schemas. Pure.

No standard has them. Names are those of this project's messages, in the notation of 3GPP.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from simple_ros_engines.network_exposure.exposure.model import ApiMalformed
from simple_ros_engines.network_exposure.exposure.schema import Schema, problems

__all__ = ["ADAPTATION", "APPLICATION", "ROOT", "Wish", "wish_of"]

ROOT = "/vaseal/v1/applications"
_TEXT: Schema = {"type": "string", "minLength": 1}
_FACTOR: Schema = {"type": "number", "minimum": 0}
_COUNT: Schema = {"type": "integer", "minimum": 0}
_FLOW: Schema = {
    "type": "object",
    "required": ("topic", "state"),
    "properties": {"topic": _TEXT, "state": _TEXT, "qci": _COUNT, "appliedQci": _COUNT},
}
APPLICATION: Schema = {
    "type": "object",
    "required": ("group", "topics", "speedFactor", "rateFactor", "validFor"),
    "properties": {
        "group": _TEXT,
        "topics": {"type": "array", "minItems": 1, "items": _TEXT},
        "score": {"type": "number", "minimum": 1, "maximum": 5},
        "judge": _TEXT,
        "speedFactor": _FACTOR,
        "rateFactor": _FACTOR,
        "flows": {"type": "array", "minItems": 0, "items": _FLOW},
        "validFor": {"type": "number", "minimum": 1},
        "notificationDestination": {
            "type": "string",
            "pattern": r"^[A-Za-z][A-Za-z0-9+.-]*://.+",
        },
    },
}
"""An application as it exposes itself."""
ADAPTATION: Schema = {
    "type": "object",
    "required": ("speedFactor", "rateFactor", "validFor"),
    "properties": {
        "speedFactor": _FACTOR,
        "rateFactor": _FACTOR,
        "validFor": {"type": "number", "minimum": 0},
        "reason": {"type": "string"},
    },
}
"""What the network asks of it."""


@dataclass(frozen=True, slots=True)
class Wish:
    """What the network asks of an application.

    Attributes:
        speed: Share of its own speed.
        rate: Share of its own rate.
        valid_s: So long.
        reason: In words.
    """

    speed: float
    rate: float
    valid_s: float
    reason: str = ""

    def body(self) -> dict[str, Any]:
        """As it is sent."""
        return {
            "speedFactor": self.speed,
            "rateFactor": self.rate,
            "validFor": self.valid_s,
            "reason": self.reason,
        }


def wish_of(data: Any, least: float, longest_s: float) -> Wish:
    """What was sent, no slower and no longer than the application allows.

    Args:
        data: The JSON.
        least: Smallest factor; 0 is taken as it.
        longest_s: Of time; 0 is taken as it.

    Raises:
        ApiMalformed: It is none.
    """
    wrong = problems(data, ADAPTATION)
    if wrong:
        raise ApiMalformed(f"adaptation: {'; '.join(wrong[:5])}")
    # The network may slow an application down, not speed it up.
    speed, rate = (
        min(1.0, max(least, float(data[name]))) for name in ("speedFactor", "rateFactor")
    )
    return Wish(
        speed,
        rate,
        min(longest_s, float(data["validFor"]) or longest_s),
        str(data.get("reason", "")),
    )
