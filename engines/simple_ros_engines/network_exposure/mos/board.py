"""What the page of scores knows and does: topics, groups that a person makes of them, stars. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from simple_ros.errors import ConfigError
from simple_ros_engines.network_exposure.mos.estimator import is_score

__all__ = ["MOST_GROUPS", "Board", "Group", "TopicStatistics"]

MOST_GROUPS = 100
_LONGEST_NAME = 64


@dataclass(slots=True)
class TopicStatistics:
    """What a topic sends."""

    rate_hz: float = 0.0
    bytes_per_s: float = 0.0
    jitter_s: float = 0.0
    is_flowing: bool = False


@dataclass(slots=True)
class Group:
    """Topics that make up one process.

    Attributes:
        topics: Of it.
        stars: 1 to 5; 0 while nobody has said.
        rated_s: When it was said.
    """

    topics: tuple[str, ...]
    stars: float = 0.0
    rated_s: float = 0.0


@dataclass(slots=True)
class Board:
    """Groups and stars. A topic is in one group at most.

    Attributes:
        topics: All that relays hand on, with what they send.
        groups: By name.
    """

    topics: dict[str, TopicStatistics] = field(default_factory=dict)
    groups: dict[str, Group] = field(default_factory=dict)

    def flows_are(self, relay_topics: Iterable[str]) -> None:
        """These topics have a flow now; others stay on the page, as silent."""
        flowing = set(relay_topics)
        for topic in flowing - self.topics.keys():
            self.topics[topic] = TopicStatistics()
        for topic, known in self.topics.items():
            known.is_flowing = topic in flowing

    def measured(self, topic: str, rate_hz: float, bytes_per_s: float, jitter_s: float) -> None:
        """What a topic sent lately."""
        known = self.topics.setdefault(topic, TopicStatistics(is_flowing=True))
        known.rate_hz, known.bytes_per_s, known.jitter_s = rate_hz, bytes_per_s, jitter_s

    def command(self, said: Mapping[str, Any], now_s: float) -> str:
        """Do what the page asks for; what was done, in words.

        Args:
            said: ``op`` is ``group`` (with ``name``, ``topics``), ``ungroup`` (``name``), ``rate`` (``name``,
                ``stars``) or ``withdraw`` (``name``).
            now_s: The time.

        Raises:
            ConfigError: It makes no sense.
        """
        operation, name = said.get("op"), said.get("name")
        if not isinstance(name, str) or not name.strip() or len(name) > _LONGEST_NAME:
            raise ConfigError(f"a group needs a name of 1 to {_LONGEST_NAME} characters")
        name = name.strip()
        match operation:
            case "group":
                return self._group(name, said.get("topics"))
            case "ungroup":
                self._known(name)
                del self.groups[name]
                return f"group {name} is gone"
            case "rate":
                return self._rate(name, said.get("stars"), now_s)
            case "withdraw":
                self._known(name).stars = 0.0
                return f"{name} has no score any more"
            case _:
                raise ConfigError(f"unknown operation {operation!r}")

    def _group(self, name: str, topics: object) -> str:
        if not isinstance(topics, list) or not topics:
            raise ConfigError("a group needs topics")
        unknown = [str(topic) for topic in topics if str(topic) not in self.topics]
        if unknown:
            raise ConfigError(f"no relay hands on {', '.join(unknown)}")
        if name not in self.groups and len(self.groups) >= MOST_GROUPS:
            raise ConfigError(f"there are {MOST_GROUPS} groups already")
        chosen = tuple(dict.fromkeys(str(topic) for topic in topics))
        for other, group in list(self.groups.items()):
            if other != name:
                group.topics = tuple(topic for topic in group.topics if topic not in chosen)
                if not group.topics:
                    del self.groups[other]
        self.groups.setdefault(name, Group(chosen)).topics = chosen
        return f"group {name} has {len(chosen)} topics"

    def _rate(self, name: str, stars: object, now_s: float) -> str:
        group = self._known(name)
        if isinstance(stars, bool) or not isinstance(stars, int | float) or not is_score(stars):
            raise ConfigError(f"stars are 1 to 5, not {stars!r}")
        group.stars, group.rated_s = float(stars), now_s
        return f"{name} has {stars:g} stars"

    def _known(self, name: str) -> Group:
        if name not in self.groups:
            raise ConfigError(f"there is no group {name!r}")
        return self.groups[name]
