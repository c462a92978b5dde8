"""Topics as agents: what each sees, what it gets for what it does. Pure; Gymnasium and PettingZoo are wrapped around it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simple_ros_engines.network_exposure.maximizer.clamp import SafetyClamp
from simple_ros_engines.network_exposure.maximizer.knobs import (
    DELAYS,
    DROPS,
    SPEEDS,
    START,
    STAY,
    Setting,
)
from simple_ros_engines.network_exposure.maximizer.plant import Plant, Repeatable, Seen
from simple_ros_engines.network_exposure.maximizer.resource import (
    TopicTraffic,
    request_of,
    requested_bps,
)
from simple_ros_engines.network_exposure.mos.estimator import BEST, WORST

__all__ = [
    "HORIZON",
    "OBSERVATION_SIZE",
    "Step",
    "TopicEnvironment",
    "Weights",
    "paper_reward",
    "saved",
]

OBSERVATION_SIZE = 8
HORIZON = 128
_OFF_DROP = 256


@dataclass(frozen=True, slots=True)
class Weights:
    """Of the reward of a topic.

    ``mos * (MOS - 1) / 4 + saved * share of the request saved - change * notches moved - bad * max(0, target - MOS)``

    Attributes:
        mos: For the score.
        saved: For what is not requested.
        change: For each notch, so that nobody fidgets.
        bad: For each unit of score below the target.
        target: The score that is good enough.
    """

    mos: float = 0.5
    saved: float = 1.0
    change: float = 0.005
    bad: float = 1.0
    target: float = 4.5

    def reward(self, seen: Seen, share_saved: float, notches: int) -> float:
        """Of one topic for one decision."""
        score = (seen.mos - WORST) / (BEST - WORST)
        missing = max(0.0, self.target - seen.mos)
        return (
            self.mos * score + self.saved * share_saved - self.change * notches - self.bad * missing
        )


def saved(traffic: TopicTraffic, setting: Setting) -> float:
    """Share of the capacity of the topic's own request that it does not ask for as it stands; below 1.

    Mean of what the requirement says, which rewards each notch, and what the class says that the network has for it.
    """
    shares = (
        1
        - requested_bps(traffic, setting, by_class=by) / requested_bps(traffic, START, by_class=by)
        for by in (False, True)
    )
    return sum(shares) / 2


def paper_reward(seen: Seen, mos_weight: float = 200.0) -> float:
    """The reward of the paper's equation 1: the weighted score, plus messages held back, minus n of each n-th left out.

    The paper's n is 0 when nothing is left out, which would be best of all; here it is the largest n then.
    """
    return (
        mos_weight * seen.mos
        + seen.setting.held_messages
        - (seen.setting.drop_every_nth or _OFF_DROP)
    )


@dataclass(frozen=True, slots=True)
class Step:
    """What came of one decision of all agents.

    Attributes:
        observations: By topic.
        rewards: By topic.
        is_truncated: Whether the episode is over; nothing ends with it.
        seen: What the observations were made of.
        reverted: Processes whose settings the clamp took back.
    """

    observations: dict[str, NDArray[np.float32]]
    rewards: dict[str, float]
    is_truncated: bool
    seen: dict[str, Seen]
    reverted: tuple[str, ...]


class TopicEnvironment:
    """Agents turn the knobs of their topics, one notch at a time.

    Args:
        plant: What they act on.
        weights: Of the reward.
        clamp: Takes back what harms; None lets everything happen.
        horizon: Decisions in an episode.
        begin: Gives where knobs are put when an episode begins; None leaves them where they are. Who trains a policy that is
            to find its way from the start must see the start, and more than once.

    Attributes:
        settings: Of the knobs, by topic.
    """

    def __init__(
        self,
        plant: Plant,
        weights: Weights | None = None,
        clamp: SafetyClamp | None = None,
        horizon: int = HORIZON,
        begin: Callable[[], Mapping[str, Setting]] | None = None,
    ) -> None:
        self.plant = plant
        self.weights = weights or Weights()
        self.settings: dict[str, Setting] = dict.fromkeys(self.agents, START)
        self._clamp = clamp
        self._horizon = horizon
        self._begin = begin
        self._steps = 0
        self._seen: dict[str, Seen] = {}

    @property
    def agents(self) -> list[str]:
        """The topics."""
        return [topic for topics in self.plant.groups.values() for topic in topics]

    @property
    def observations(self) -> dict[str, NDArray[np.float32]]:
        """What the agents see now, by topic."""
        return {topic: self._observation(topic) for topic in self.settings}

    def reset(
        self, settings: Mapping[str, Setting] | None = None, seed: int | None = None
    ) -> dict[str, NDArray[np.float32]]:
        """Begin an episode; the process goes on, with its knobs where they are or where they are put.

        Args:
            settings: Where the knobs are put.
            seed: Begins a simulated process anew, with nothing made worse. Live topics go on all the same.
        """
        self._steps = 0
        if seed is not None and isinstance(self.plant, Repeatable):
            self.plant.restart(seed)
            self.settings = dict.fromkeys(self.agents, START)
            if self._clamp is not None:
                self._clamp.forget()
        if settings is None and self._begin is not None:
            settings = self._begin()
        if settings is not None:
            self.settings = {topic: settings.get(topic, START) for topic in self.agents}
        self._seen = self.plant.advance(self.settings)
        return self.observations

    def step(self, actions: Mapping[str, Sequence[int]]) -> Step:
        """Everybody turns a knob, a decision period passes.

        Args:
            actions: By topic: three of -1, 0 and 1, for delay, drop and speed.

        Raises:
            ConfigError: An action is none.
        """
        before = self.settings
        wanted = {topic: before[topic].moved(actions.get(topic, STAY)) for topic in before}
        reverted: tuple[str, ...] = ()
        if self._clamp is not None:
            wanted, reverted = self._clamp.guard(self._seen, before, wanted)
        self.settings = wanted
        self._seen = self.plant.advance(wanted)
        self._steps += 1
        rewards = {topic: self._reward(topic, before[topic]) for topic in wanted}
        is_over = self._steps >= self._horizon
        return Step(self.observations, rewards, is_over, dict(self._seen), reverted)

    def _reward(self, topic: str, before: Setting) -> float:
        here = self.settings[topic]
        notches = sum(
            abs(one - other) for one, other in zip(here.notches, before.notches, strict=True)
        )
        share = saved(self.plant.traffic(topic), here)
        return self.weights.reward(self._seen[topic], share, notches)

    def _observation(self, topic: str) -> NDArray[np.float32]:
        seen, setting = self._seen[topic], self.settings[topic]
        numbers = (
            min(1.0, math.log10(1 + seen.bytes_per_s) / 8),
            min(1.0, seen.jitter_s),
            (seen.mos - WORST) / (BEST - WORST),
            setting.delay / (len(DELAYS) - 1),
            setting.drop / (len(DROPS) - 1),
            setting.speed / (len(SPEEDS) - 1),
            min(1.0, request_of(self.plant.traffic(topic), setting).chosen.delay_ms / 500),
            float(seen.is_downgraded),
        )
        return np.array(numbers, dtype=np.float32)
