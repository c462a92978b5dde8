"""The agent that needs nothing but Python: it climbs, one knob at a time, as far as the reward rises. No input or output.

Each process has a learner of its own, in which its topics take turns or trade. It holds the best settings it knows (the
incumbent), tries a neighbour of them for some decisions, keeps it if its mean reward is better, and goes back if not. A
direction that was good is tried again at once, one that was not only after all others. A score that is not good enough
ends a trial early; an incumbent that turns out not to be good enough is given up for the one before. What harmed is
not tried again for long, nor anything that is worse than that in every respect.
"""

from __future__ import annotations

import math
import random
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import permutations

from simple_ros_engines.network_exposure.maximizer.knobs import (
    KNOBS,
    START,
    Action,
    Setting,
)

__all__ = ["LoopLearner", "SearchRules"]

Settings = dict[str, Setting]
Turn = tuple[str, int, int]
"""Topic, knob, notches."""
Direction = tuple[Turn, ...]
_STRIDES = (1, 2, 4)
_MOST_MEMORY = 20
_MOST_BANNED = 30
"""So many are remembered: a turtle also goes wrong by bad luck, and deserves another chance some time."""


@dataclass(frozen=True, slots=True)
class SearchRules:
    """How patiently it searches.

    Attributes:
        samples: Decisions that a neighbour is tried for.
        target: Mean score that settings must have to be kept.
        floor: Score that ends a trial at once.
        margin: Reward by which a neighbour must be better.
        recovery: Decisions after its return for which the incumbent is not judged: the process must recover.
    """

    samples: int = 6
    target: float = 4.6
    floor: float = 4.1
    margin: float = 0.003
    recovery: int = 2


@dataclass(slots=True)
class _Place:
    """Settings, and what is known of them."""

    settings: Settings
    count: int = 0
    reward: float = 0.0
    mos: float = 0.0

    def add(self, reward: float, mos: float, memory: int) -> None:
        self.count += 1
        share = 1 / min(self.count, memory)
        self.reward += share * (reward - self.reward)
        self.mos += share * (mos - self.mos)


@dataclass(slots=True)
class LoopLearner:
    """Learns the settings of one process.

    Attributes:
        topics: Of the process.
        rules: How it searches.
        draw: Where it looks next.
        learns: Whether it tries anything; if not it goes to the best settings it knows and stays.
        trials: Neighbours tried so far.
        kept: Those of them that were better.
    """

    topics: tuple[str, ...]
    rules: SearchRules = field(default_factory=SearchRules)
    draw: random.Random = field(default_factory=random.Random)
    learns: bool = True
    trials: int = 0
    kept: int = 0
    _best: _Place = field(init=False)
    _before: list[_Place] = field(default_factory=list)
    _trial: _Place | None = None
    _direction: Direction | None = None
    _untried: list[Direction] = field(default_factory=list)
    _banned: deque[Settings] = field(default_factory=lambda: deque(maxlen=_MOST_BANNED))
    _returned: int = 0
    _blamed: int = 0

    def __post_init__(self) -> None:
        self._best = _Place(dict.fromkeys(self.topics, START))

    @property
    def best(self) -> Settings:
        """The best settings known."""
        return dict(self._best.settings)

    @best.setter
    def best(self, settings: Mapping[str, Setting]) -> None:
        self._best = _Place({topic: settings.get(topic, START) for topic in self.topics})
        self._before.clear()
        self._trial = None

    def act(self, settings: Mapping[str, Setting]) -> dict[str, Action]:
        """What each topic does next, from where it is."""
        if self.learns and self._trial is None and self._is_known(settings):
            self._begin_trial()
        goal = self._best if self._trial is None else self._trial
        return {topic: settings[topic].towards(goal.settings[topic]) for topic in self.topics}

    def learn(self, settings: Mapping[str, Setting], reward: float, mos: float) -> None:
        """What came of the last decision.

        Args:
            settings: That were in force.
            reward: Mean of the process's topics.
            mos: Score of the process.
        """
        if not (math.isfinite(reward) and math.isfinite(mos)):
            return
        if mos >= self.rules.target:
            self._blamed = 0
        here = {topic: settings[topic] for topic in self.topics}
        if not self.learns:
            self._returned = self._returned + 1 if here == self._best.settings else 0
            return
        if self._trial is not None and here == self._trial.settings:
            self._returned = 0
            self._trial.add(reward, mos, self.rules.samples)
            self._judge_trial(mos)
        elif here == self._best.settings:
            self._returned += 1
            if self._returned <= self.rules.recovery:
                return
            self._best.add(reward, mos, _MOST_MEMORY)
            if mos < self.rules.floor:
                self.harmed()
            else:
                self._doubt()

    def harmed(self) -> None:
        """The settings were taken back, since the score was bad."""
        has_recovered, self._returned = self._returned > self.rules.recovery, 0
        if self._trial is not None:
            self._ban(self._trial.settings)
            self._end_trial()
        elif has_recovered or self._blamed >= self.rules.recovery:
            self._blamed = 0
            self._ban(self._best.settings)
            self._back_off()
        else:
            # As long as the process recovers from something else, the incumbent need not be the reason.
            self._blamed += 1

    def _end_trial(self) -> None:
        self._trial = self._direction = None

    def _back_off(self) -> None:
        """Take the incumbent before; without one, a notch nearer to nothing at all made worse."""
        best = self._best.settings
        nearer = {topic: one.moved(one.towards(START)) for topic, one in best.items()}
        self._best = self._before.pop() if self._before else _Place(nearer)
        self._best.count = 0
        self._untried.clear()
        self._end_trial()

    def _ban(self, settings: Settings) -> None:
        is_start = all(one == START for one in settings.values())
        if not is_start and not self._is_banned(settings):
            self._banned.append(dict(settings))

    def _is_banned(self, settings: Settings) -> bool:
        return any(
            all(settings[topic].is_as_bad_as(bad) for topic, bad in banned.items())
            for banned in self._banned
        )

    def _is_known(self, settings: Mapping[str, Setting]) -> bool:
        here = {topic: settings[topic] for topic in self.topics}
        is_there = here == self._best.settings and self._returned > self.rules.recovery
        return is_there and self._best.count >= self.rules.samples

    def _doubt(self) -> None:
        """Give up the incumbent if it is not good enough after all."""
        best = self._best
        if best.count >= self.rules.samples and best.mos < self.rules.target and self._before:
            self._ban(best.settings)
            self._back_off()

    def _begin_trial(self) -> None:
        for _ in range(2 * len(self._directions())):
            direction = self._direction or self._next_direction()
            self._direction = None
            place = self.best
            for topic, knob, step in direction:
                place[topic] = _turned(place[topic], knob, step)
            if place != self._best.settings and not self._is_banned(place):
                self._trial = _Place(place)
                self._direction = direction
                self.trials += 1
                return

    def _judge_trial(self, mos: float) -> None:
        trial, rules = self._trial, self.rules
        assert trial is not None
        if mos >= rules.floor and trial.count < rules.samples:
            return
        is_good = mos >= rules.floor and trial.mos >= min(rules.target, self._best.mos)
        if is_good and trial.reward > self._best.reward + rules.margin:
            self._before = [*self._before[-_MOST_MEMORY:], self._best]
            self._best = trial
            self._trial = None
            self._returned = self.rules.recovery + 1
            self.kept += 1
        else:
            if not is_good:
                self._ban(trial.settings)
            self._end_trial()

    def _next_direction(self) -> Direction:
        if not self._untried:
            self._untried = self._directions()
            self.draw.shuffle(self._untried)
        return self._untried.pop()

    def _directions(self) -> list[Direction]:
        single: list[Direction] = [
            ((topic, knob, step),)
            for topic in self.topics
            for knob in range(len(KNOBS))
            for stride in _STRIDES
            for step in (-stride, stride)
            # Only who commands has a speed.
            if KNOBS[knob] != "speed" or (topic == self.topics[-1] and stride == 1)
        ]
        # What one topic gives up another may be able to use better.
        swaps: list[Direction] = [
            ((one, 0, -1), (other, 0, stride))
            for one, other in permutations(self.topics, 2)
            for stride in _STRIDES
        ]
        return single + swaps


def _turned(setting: Setting, knob: int, step: int) -> Setting:
    """A knob some notches further, or at its end."""
    one = 1 if step > 0 else -1
    for _ in range(abs(step)):
        setting = setting.moved([one if index == knob else 0 for index in range(len(KNOBS))])
    return setting
