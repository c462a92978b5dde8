"""Learning which choice pays, without paying much for it: Q-learning, pure.

``Q(s,a) += rate (r + discount max_a' Q(s',a') - Q(s,a))`` (Watkins, 1989), on the action that was really
applied, with the reward measured after it took effect. Actions are corrections of a heuristic, so that
the first guess is never worse than it. Exploring is on a budget: the estimated loss against the
heuristic may not exceed a share of what the heuristic earns (Wu et al., "Conservative Bandits", ICML
2016).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from simple_ros.errors import ConfigError

__all__ = ["Action", "Generator", "QLearner", "QSettings", "State", "discretize_state"]

State = tuple[int, int, int, int]
Action = tuple[int, ...]


class Generator(Protocol):
    """What is needed of `random.Random`."""

    def random(self) -> float:
        """Uniform in 0..1."""


def discretize_state(snr_db: float, bler: float, buffer_bytes: float, criticality: float) -> State:
    """Bins of a link's state: 5 of 8 dB from -10 dB, 5 of 0.1, 5 of 20 kB, 3 of criticality."""

    def bin_of(value: float, count: int) -> int:
        return max(0, min(count - 1, math.floor(value)))

    return (
        bin_of((snr_db + 10) / 8, 5),
        bin_of(bler * 10 + 1e-9, 5),
        bin_of(buffer_bytes / 20_000, 5),
        bin_of(criticality * 3, 3),
    )


_PROOF = 8
"""Experiences after which an action's value is believed."""
_SETTLING = 200
"""Experiences of an action after which its value settles."""
_MEMORY = 0.995
"""Weight of older rewards in the account of what exploring costs."""


@dataclass(frozen=True, slots=True)
class QSettings:
    """How to learn.

    Attributes:
        learning_rate: Weight of a new experience.
        discount: Of later rewards.
        exploration: First share of other choices.
        min_exploration: It decays to this.
        decay: Per learnt experience.
        budget: Estimated loss against the heuristic that exploring may cost, as a share of its reward.
    """

    learning_rate: float = 0.1
    discount: float = 0.9
    exploration: float = 0.2
    min_exploration: float = 0.05
    decay: float = 0.01
    budget: float = 0.03

    def __post_init__(self) -> None:
        if not 0 < self.learning_rate <= 1 or not 0 <= self.discount < 1:
            raise ConfigError("learning_rate must be in 0..1, discount at least 0 and below 1")
        if not 0 <= self.min_exploration <= self.exploration <= 1:
            raise ConfigError("0 <= min_exploration <= exploration <= 1 must hold")


def _steps(one: Action, other: Action) -> int:
    return sum(abs(a - b) for a, b in zip(one, other, strict=True))


@dataclass(slots=True)
class _Row:
    values: list[float]
    rewards: list[float]
    counts: list[int]


@dataclass(slots=True)
class QLearner:
    """The table of one link.

    Attributes:
        actions: What can be done, as steps in each direction; exploring goes one step from the best.
        heuristic: Index of the action that follows the heuristic.
        settings: How to learn.
        episodes: Experiences learnt.
        recent: The last rewards.
    """

    actions: Sequence[Action]
    heuristic: int
    settings: QSettings = field(default_factory=QSettings)
    episodes: int = 0
    recent: deque[float] = field(default_factory=lambda: deque(maxlen=1000))
    _rows: dict[Hashable, _Row] = field(default_factory=dict)
    _near: list[list[int]] = field(default_factory=list)
    _earned: float = 0.0
    _spent: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.heuristic < len(self.actions):
            raise ConfigError(
                f"heuristic {self.heuristic} is no index of {len(self.actions)} actions"
            )
        self._find_near()

    def _find_near(self) -> None:
        self._near = [
            [i for i, other in enumerate(self.actions) if _steps(action, other) == 1]
            for action in self.actions
        ]

    def exploration_rate(self) -> float:
        """Present share of other choices."""
        settings = self.settings
        faded = settings.exploration * math.exp(-settings.decay * self.episodes)
        return max(settings.min_exploration, faded)

    def value(self, state: Hashable, action: int) -> float:
        """What an action is believed to be worth."""
        row = self._rows.get(state)
        return row.values[action] if row else 0.0

    def states_seen(self) -> int:
        """How many states there were."""
        return len(self._rows)

    def best(self, state: Hashable) -> int:
        """The action believed best; the heuristic where nothing is known to beat it."""
        row = self._rows.get(state)
        if row is None or row.counts[self.heuristic] < _PROOF:
            return self.heuristic
        best = self.heuristic
        for action, count in enumerate(row.counts):
            # A few lucky rewards are no proof.
            if count >= _PROOF and row.values[action] > row.values[best]:
                best = action
        return best

    def choose(self, state: Hashable, generator: Generator) -> int:
        """The action to apply, sometimes another one than the best."""
        if self._spent > self.settings.budget * self._earned:
            return self.heuristic
        best = self.best(state)
        row = self._rows.get(state)
        if row is None or row.counts[self.heuristic] < _PROOF:
            return best
        if generator.random() >= self.exploration_rate():
            return best
        near = [action for action in self._near[best] if self._is_bearable(row, action)]
        return near[int(generator.random() * len(near)) % len(near)] if near else best

    def _is_bearable(self, row: _Row, action: int) -> bool:
        """Whether trying it once more is worth it: what proved to be much worse is not."""
        if row.counts[action] < _PROOF:
            return True
        return row.rewards[action] > 0.8 * row.rewards[self.heuristic]

    def learn(self, state: Hashable, applied: int, reward: float, following: Hashable) -> None:
        """Learn from one step.

        Args:
            state: Where it was applied.
            applied: Index of the action really applied.
            reward: What it brought, measured after it took effect.
            following: The state it led to.
        """
        row = self._row(state)
        self.recent.append(reward)
        settings = self.settings
        target = reward + settings.discount * self._worth(following)
        if applied != self.heuristic and not row.counts[applied] and row.counts[self.heuristic]:
            # It starts from what the heuristic is worth by now; from zero it would lag for long.
            ahead = reward - row.rewards[self.heuristic]
            row.values[applied] = row.values[self.heuristic] + ahead
            row.counts[applied] = 1
        row.counts[applied] += 1
        rate = self._rate(row.counts[applied])
        row.values[applied] += rate * (target - row.values[applied])
        row.rewards[applied] += rate * (reward - row.rewards[applied])
        self.episodes += 1
        self._account(row, applied, reward)

    def _rate(self, count: int) -> float:
        """Weight of an experience: the mean at first, then the setting, then less and less (Robbins, Monro, 1951)."""
        most = self.settings.learning_rate
        return max(1 / count, min(most, _SETTLING * most / count), 0.1 * most)

    def _worth(self, state: Hashable) -> float:
        """The best action's value; for a state never seen, what the mean reward for ever is worth."""
        row = self._rows.get(state)
        tried = [v for v, n in zip(row.values, row.counts, strict=True) if n] if row else []
        if tried:
            return max(tried)
        return (self.mean_reward() or 0.0) / (1 - self.settings.discount)

    def _account(self, row: _Row, applied: int, reward: float) -> None:
        usual = reward if applied == self.heuristic else row.rewards[self.heuristic]
        self._earned = _MEMORY * self._earned + max(0.0, usual)
        self._spent = max(0.0, _MEMORY * self._spent + usual - reward)

    def _row(self, state: Hashable) -> _Row:
        row = self._rows.get(state)
        if row is None:
            count = len(self.actions)
            row = self._rows[state] = _Row([0.0] * count, [0.0] * count, [0] * count)
        return row

    def mean_reward(self) -> float | None:
        """Of the last 1000 experiences; None before the first."""
        return sum(self.recent) / len(self.recent) if self.recent else None
