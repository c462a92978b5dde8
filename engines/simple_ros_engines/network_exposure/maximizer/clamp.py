"""The safety clamp: what harmed a process is taken back, whatever the policy wants. Pure."""

from __future__ import annotations

from collections.abc import Mapping

from simple_ros.errors import ConfigError
from simple_ros_engines.network_exposure.maximizer.knobs import START, Setting
from simple_ros_engines.network_exposure.maximizer.plant import Seen
from simple_ros_engines.network_exposure.mos.estimator import is_score

__all__ = ["SafetyClamp"]

Settings = dict[str, Setting]


class SafetyClamp:
    """Remembers with which settings each process was well.

    When a score falls below ``least`` its process goes back to the last settings that were good, all topics at once. It
    has some decisions to recover; if it does not, its settings come nearer to nothing at all made worse, by one notch each
    time. While the network gives less than was asked for nothing is moved: the settings are not the reason.

    Args:
        groups: Topics by process.
        least: Score below which settings are taken back.
        recovery: Decisions to recover.

    Raises:
        ConfigError: ``least`` is no score.
    """

    def __init__(
        self, groups: Mapping[str, tuple[str, ...]], least: float = 4.0, recovery: int = 2
    ) -> None:
        if not is_score(least):
            raise ConfigError(f"least must be a score from 1 to 5, not {least}")
        self._groups = groups
        self._least = least
        self._recovery = recovery
        self._waited: dict[str, int] = {}
        self._safe: dict[str, Settings] = {}

    def forget(self) -> None:
        """The processes were begun anew."""
        self._waited.clear()
        self._safe.clear()

    def guard(
        self, seen: Mapping[str, Seen], now: Mapping[str, Setting], wanted: Mapping[str, Setting]
    ) -> tuple[Settings, tuple[str, ...]]:
        """What may be set, and which processes were held back.

        Args:
            seen: By topic, with the settings ``now``; may be empty at the beginning.
            now: Settings in force.
            wanted: Settings that the policy wants next.
        """
        allowed, reverted = dict(wanted), []
        for group, topics in self._groups.items():
            scores = [seen[topic].mos for topic in topics if topic in seen]
            here = {topic: now[topic] for topic in topics}
            if not scores:
                continue
            if any(topic in seen and seen[topic].is_downgraded for topic in topics):
                allowed.update(here)
                continue
            if min(scores) >= self._least:
                self._safe[group] = here
                self._waited[group] = 0
                continue
            back = self._safe.get(group, dict.fromkeys(topics, START))
            self._waited[group] = self._waited.get(group, 0) + 1 if back == here else 0
            if self._waited[group] > self._recovery:
                self._waited[group] = 0
                back = {topic: one.moved(one.towards(START)) for topic, one in here.items()}
                self._safe[group] = back
            if any(allowed[topic] != back[topic] for topic in topics):
                reverted.append(group)
            allowed.update(back)
        return allowed, tuple(reverted)
