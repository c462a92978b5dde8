"""Train the agent on an environment, and try policies on it. No input or output."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from statistics import fmean

from simple_ros_engines.network_exposure.maximizer.agent import LoopLearner, SearchRules
from simple_ros_engines.network_exposure.maximizer.environment import (
    Step,
    TopicEnvironment,
    paper_reward,
)
from simple_ros_engines.network_exposure.maximizer.knobs import STAY, Action, Setting

__all__ = [
    "Episode",
    "chooser",
    "learners_for",
    "random_actions",
    "run_episode",
    "stay_actions",
    "train",
]

Chooser = Callable[[Mapping[str, Setting]], dict[str, Action]]
"""What all topics do next."""


@dataclass(frozen=True, slots=True)
class Episode:
    """What an episode was like, means over it.

    Attributes:
        reward: Of all topics.
        paper_reward: The same by the paper's equation.
        mos: By process.
        progress_mps: By process.
        reverted: Decisions that the clamp took back.
        settings: At its end.
    """

    reward: float
    paper_reward: float
    mos: dict[str, float]
    progress_mps: dict[str, float]
    reverted: int
    settings: dict[str, Setting]


def learners_for(
    environment: TopicEnvironment, seed: int, rules: SearchRules | None = None
) -> dict[str, LoopLearner]:
    """A learner for each process."""
    draw = random.Random(seed)  # noqa: S311
    return {
        group: LoopLearner(topics, rules or SearchRules(), random.Random(draw.random()))  # noqa: S311
        for group, topics in environment.plant.groups.items()
    }


def random_actions(seed: int) -> Chooser:
    """The untrained policy: any notch."""
    draw = random.Random(seed)  # noqa: S311

    def choose(settings: Mapping[str, Setting]) -> dict[str, Action]:
        return {
            topic: (draw.randint(-1, 1), draw.randint(-1, 1), draw.randint(-1, 1))
            for topic in settings
        }

    return choose


def stay_actions(settings: Mapping[str, Setting]) -> dict[str, Action]:
    """Leave everything as it is."""
    return dict.fromkeys(settings, STAY)


def run_episode(
    environment: TopicEnvironment, choose: Chooser, told: Callable[[Step], None] | None = None
) -> Episode:
    """One episode of a policy.

    Args:
        environment: Where; its knobs stay where they are.
        choose: The policy.
        told: Called with each step.
    """
    environment.reset()
    steps: list[Step] = []
    while not steps or not steps[-1].is_truncated:
        step = environment.step(choose(environment.settings))
        steps.append(step)
        if told is not None:
            told(step)
    groups = environment.plant.groups
    return Episode(
        fmean(reward for step in steps for reward in step.rewards.values()),
        fmean(paper_reward(seen) for step in steps for seen in step.seen.values()),
        {g: fmean(step.seen[topics[0]].mos for step in steps) for g, topics in groups.items()},
        {
            g: fmean(step.seen[topics[0]].progress_mps for step in steps)
            for g, topics in groups.items()
        },
        sum(len(step.reverted) for step in steps),
        dict(environment.settings),
    )


def train(
    environment: TopicEnvironment, learners: Mapping[str, LoopLearner], episodes: int
) -> list[Episode]:
    """Let the learners work for so many episodes; what each was like."""

    def learn(step: Step) -> None:
        for group, learner in learners.items():
            if any(step.seen[topic].is_downgraded for topic in learner.topics):
                # Whatever it is like now, it is not for what was tried.
                continue
            if group in step.reverted:
                learner.harmed()
            mean = fmean(step.rewards[topic] for topic in learner.topics)
            mos = min(step.seen[topic].mos for topic in learner.topics)
            learner.learn(environment.settings, mean, mos)

    choose = chooser(learners)
    return [run_episode(environment, choose, learn) for _ in range(episodes)]


def chooser(learners: Mapping[str, LoopLearner]) -> Chooser:
    """The policy that the learners make up."""

    def choose(settings: Mapping[str, Setting]) -> dict[str, Action]:
        actions: dict[str, Action] = {}
        for learner in learners.values():
            actions.update(learner.act(settings))
        return actions

    return choose
