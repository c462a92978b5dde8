"""Follow networks: each topic's network decides, but what harmed a process is not tried again for a while. No input or output."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping

from simple_ros_engines.network_exposure.maximizer.environment import Step, TopicEnvironment
from simple_ros_engines.network_exposure.maximizer.knobs import START, STAY, Action, Setting
from simple_ros_engines.network_exposure.maximizer.network import NetworkPolicy

__all__ = ["NetworkFollower"]

Settings = dict[str, Setting]


class NetworkFollower:
    """The policy of an environment whose topics have networks.

    When the clamp takes back what a network did, that network would do the same again from where it is put: so what stands no
    better than what harmed is out of bounds for ``memory`` decisions, and the process stays where it is instead.

    Args:
        environment: Whose observations the networks see.
        policy: The networks; a topic without one is left alone.
        memory: Decisions.
        target: Score that settings must have had to be settled on.
    """

    def __init__(
        self,
        environment: TopicEnvironment,
        policy: NetworkPolicy,
        memory: int = 128,
        target: float = 4.6,
    ) -> None:
        self._environment = environment
        self._networks = {topic: policy.of(topic) for topic in environment.agents}
        self._memory = memory
        self._target = target
        self._decisions = 0
        self._visits: list[tuple[Settings, dict[str, float]]] = []
        self._before: Settings = {}
        self._harmful: dict[str, list[tuple[int, Settings]]] = {}

    def choose(self, settings: Mapping[str, Setting]) -> dict[str, Action]:
        """What all topics do next."""
        self._before = dict(settings)
        self._decisions += 1
        seen = self._environment.observations
        actions = {
            topic: STAY if network is None else network.act(seen[topic])
            for topic, network in self._networks.items()
        }
        for group, topics in self._environment.plant.groups.items():
            wanted = {topic: settings[topic].moved(actions[topic]) for topic in topics}
            if self._is_out_of_bounds(group, wanted):
                actions.update(dict.fromkeys(topics, STAY))
        return actions

    def told(self, step: Step) -> None:
        """What came of it: remembers what the clamp took back, and how good settings were."""
        groups = self._environment.plant.groups
        scores = {group: min(step.seen[t].mos for t in topics) for group, topics in groups.items()}
        self._visits.append((dict(self._environment.settings), scores))
        for group in step.reverted:
            harmful = {topic: self._before[topic] for topic in groups[group]}
            if any(one != START for one in harmful.values()):
                self._harmful.setdefault(group, []).append((self._decisions, harmful))

    @property
    def settled(self) -> dict[str, Settings]:
        """Where each process was most of the later half of the time, of what was good enough on average; else its start."""
        later = self._visits[len(self._visits) // 2 :]
        return {
            group: self._settled(topics, [(where, scores[group]) for where, scores in later])
            for group, topics in self._environment.plant.groups.items()
        }

    def _settled(self, topics: tuple[str, ...], visits: list[tuple[Settings, float]]) -> Settings:
        times: Counter[tuple[Setting, ...]] = Counter()
        total: defaultdict[tuple[Setting, ...], float] = defaultdict(float)
        for where, score in visits:
            here = tuple(where[topic] for topic in topics)
            times[here] += 1
            total[here] += score
        for here, count in times.most_common():
            if total[here] / count >= self._target:
                return dict(zip(topics, here, strict=True))
        return dict.fromkeys(topics, START)

    def _is_out_of_bounds(self, group: str, wanted: Settings) -> bool:
        known = self._harmful.get(group, [])
        known[:] = [one for one in known if self._decisions - one[0] < self._memory]
        return any(
            all(wanted[topic].is_as_bad_as(bad) for topic, bad in harmful.items())
            for _, harmful in known
        )
