"""Tags of topics: what a relay does with a topic is in the end of its name. Pure.

``pose_qos`` is relayed to ``pose``. ``image_qos_out`` goes through a tunnel: encapsulated on
``image_qos_tunnel`` (or on ``image_QCI_8`` and its like, one for each class), and out of it on ``image_qos_in``.
Only the end counts, case matters, and the longest tag wins.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum

from simple_ros.errors import ConfigError

__all__ = ["Role", "TagRules", "Tagged"]

_NUMBER = "<n>"
_MAX_QCI = 255


class Role(Enum):
    """What a tag asks for."""

    RELAY = "relay"
    """Relayed under the name without its tag."""
    TUNNEL_START = "out"
    """Goes into a tunnel."""
    TUNNEL_END = "in"
    """Came out of one."""
    TUNNEL = "tunnel"
    """Inside one."""


@dataclass(frozen=True, slots=True)
class Tagged:
    """A topic with a tag.

    Attributes:
        topic: As it was.
        base: Without its tag.
        role: What the tag asks for.
        qci: Of a tunnel for one class; 0 if for any.
    """

    topic: str
    base: str
    role: Role
    qci: int = 0


@dataclass(frozen=True, slots=True)
class TagRules:
    """The tags.

    Attributes:
        relay: Of topics to relay.
        start: Of topics to send through a tunnel.
        end: Of topics that came through one.
        tunnel: Of the tunnel's own topic, with no class.
        per_qci: The same for one class; ``<n>`` stands for its number.

    Raises:
        ConfigError: Tags are equal, empty, or have characters that names do not.
    """

    relay: str = "_qos"
    start: str = "_qos_out"
    end: str = "_qos_in"
    tunnel: str = "_qos_tunnel"
    per_qci: str = "_QCI_<n>"

    def __post_init__(self) -> None:
        tags = (self.relay, self.start, self.end, self.tunnel, self.per_qci)
        if len(set(tags)) != len(tags):
            raise ConfigError(f"each tag must differ from the others: {', '.join(tags)}")
        for tag in tags:
            if not re.fullmatch(r"\w+", tag.replace(_NUMBER, "1")):
                raise ConfigError(f"tag {tag!r} must be of letters, digits and underscores")
        if self.per_qci.count(_NUMBER) != 1 or not self.per_qci.endswith(_NUMBER):
            raise ConfigError(f"tag {self.per_qci!r} must end in {_NUMBER}")

    def parse(self, topic: str) -> Tagged | None:
        """What the end of a name says; None without a tag, or if nothing is left without it."""
        stem = self.per_qci.removesuffix(_NUMBER)
        found = re.fullmatch(rf"(.*){re.escape(stem)}([0-9]+)", topic)
        if found and int(found[2]) <= _MAX_QCI and self._is_name(found[1]):
            return Tagged(topic, found[1], Role.TUNNEL, int(found[2]))
        plain = {
            self.relay: Role.RELAY,
            self.start: Role.TUNNEL_START,
            self.end: Role.TUNNEL_END,
            self.tunnel: Role.TUNNEL,
        }
        for tag in sorted(plain, key=len, reverse=True):
            if topic.endswith(tag) and self._is_name(topic.removesuffix(tag)):
                return Tagged(topic, topic.removesuffix(tag), plain[tag])
        return None

    def tunnel_topic(self, base: str, qci: int = 0) -> str:
        """Where a tunnel of a topic runs."""
        return base + (self.per_qci.replace(_NUMBER, str(qci)) if qci else self.tunnel)

    def out_topic(self, base: str) -> str:
        """Where a topic comes out of its tunnels."""
        return base + self.end

    @staticmethod
    def _is_name(base: str) -> bool:
        return base.rpartition("/")[2] != ""
