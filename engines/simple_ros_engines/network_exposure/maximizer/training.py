"""Train the agent on an environment, and try policies on it. No input or output."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean

from simple_ros_engines.network_exposure.maximizer.agent import LoopLearner, SearchRules
from simple_ros_engines.network_exposure.maximizer.environment import (
    Step,
    TopicEnvironment,
    paper_reward,
)
from simple_ros_engines.network_exposure.maximizer.knobs import START, STAY, Action, Setting
from simple_ros_engines.network_exposure.maximizer.resource import requested_bps

__all__ = [
    "Episode",
    "chooser",
    "learners_for",
    "random_actions",
    "run_episode",
    "scattered",
    "share_saved",
    "stay_actions",
    "train",
]

_FAR = 6
Chooser = Callable[[Mapping[str, Setting]], dict[str, Action]]
"""What all topics do next."""


@dataclass(frozen=True, slots=True)
class Episode:
    """What an episode was like, means over it.

    Attributes:
        reward: Of all topics.
        paper_reward: The same by the paper's equation.
        mos: By process.
        progress_mps: By process, as its controller knows it.
        saved_by_class: Share of the mapper's own request that was not asked for, counted as `share_saved` does.
        saved_by_requirement: The same by what is required, without the steps of QoS classes.
        reverted: Decisions that the clamp took back.
        settings: At its end.
    """

    reward: float
    paper_reward: float
    mos: dict[str, float]
    progress_mps: dict[str, float]
    saved_by_class: float
    saved_by_requirement: float
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


def scattered(topics: Sequence[str], seed: int) -> Callable[[], dict[str, Setting]]:
    """Where episodes begin from which a policy is learnt: half of them at the start, half anywhere that is not hopeless."""
    draw = random.Random(seed)  # noqa: S311

    def anywhere() -> Setting:
        return Setting(draw.randint(0, _FAR), draw.randint(0, _FAR), START.speed)

    def begin() -> dict[str, Setting]:
        is_start = draw.random() < 0.5
        return {topic: START if is_start else anywhere() for topic in topics}

    return begin


def stay_actions(settings: Mapping[str, Setting]) -> dict[str, Action]:
    """Leave everything as it is."""
    return dict.fromkeys(settings, STAY)


def share_saved(
    environment: TopicEnvironment, settings: Mapping[str, Setting], *, by_class: bool
) -> float:
    """Share of the capacity of the mapper's own requests, all topics together, that settings do not ask for.

    Args:
        environment: Whose topics they are.
        settings: By topic.
        by_class: See `requested_bps`.
    """

    def total(where: Mapping[str, Setting]) -> float:
        return sum(
            requested_bps(environment.plant.traffic(topic), one, by_class=by_class)
            for topic, one in where.items()
        )

    return 1 - total(settings) / total(dict.fromkeys(settings, START))


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
    shares: list[tuple[float, float]] = []
    while not steps or not steps[-1].is_truncated:
        step = environment.step(choose(environment.settings))
        steps.append(step)
        here = environment.settings
        by_class = share_saved(environment, here, by_class=True)
        shares.append((by_class, share_saved(environment, here, by_class=False)))
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
        fmean(by_class for by_class, _ in shares),
        fmean(by_requirement for _, by_requirement in shares),
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
