"""Try a policy on simulated turtles that it was not trained on, beside the mapper's own request and any notch at all. No input or output."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from statistics import median

from simple_ros_engines.network_exposure.maximizer.agent import LoopLearner
from simple_ros_engines.network_exposure.maximizer.clamp import SafetyClamp
from simple_ros_engines.network_exposure.maximizer.environment import TopicEnvironment
from simple_ros_engines.network_exposure.maximizer.follower import NetworkFollower
from simple_ros_engines.network_exposure.maximizer.network import NetworkPolicy
from simple_ros_engines.network_exposure.maximizer.plant import SimulatedTurtles
from simple_ros_engines.network_exposure.maximizer.training import (
    Episode,
    random_actions,
    run_episode,
    stay_actions,
    train,
)

__all__ = ["UNSEEN", "Outcome", "against", "hold", "trial_lines", "try_network"]

UNSEEN = 10_000
"""Seeds from here on are never trained on."""
Run = Callable[[SimulatedTurtles], Episode]


@dataclass(frozen=True, slots=True)
class Outcome:
    """One trial.

    Attributes:
        mos: Of the worse process, mean over the episode.
        speed: Real mean speed of the slower process against itself without any change.
        saved_by_class: Share of the mapper's own request not asked for, mean over the episode.
        saved_by_requirement: The same, without the steps of QoS classes.
        paper_over_untrained: Paper's reward, more than any notch at all.
        paper_over_idle: Paper's reward, more than nothing made worse.
        reverted: Decisions that the clamp took back.
        episode: What it was like.
    """

    mos: float
    speed: float
    saved_by_class: float
    saved_by_requirement: float
    paper_over_untrained: float
    paper_over_idle: float
    reverted: int
    episode: Episode


def against(world: Callable[[], SimulatedTurtles], run: Run, seed: int) -> Outcome:
    """Run a policy, nothing at all, and any notch at all in the same world.

    Args:
        world: Makes it anew.
        run: Runs an episode of the policy.
        seed: Of the random notches.
    """
    ours, original, chance = world(), world(), world()
    episode = run(ours)
    idle = run_episode(TopicEnvironment(original), stay_actions)
    untrained = run_episode(TopicEnvironment(chance), random_actions(seed))
    before = original.speeds_mps
    return Outcome(
        min(episode.mos.values()),
        min(speed / before[name] for name, speed in ours.speeds_mps.items()),
        episode.saved_by_class,
        episode.saved_by_requirement,
        episode.paper_reward - untrained.paper_reward,
        episode.paper_reward - idle.paper_reward,
        episode.reverted,
        episode,
    )


def try_network(policy: NetworkPolicy, seed: int) -> Outcome:
    """Networks on turtles that nobody has trained on: they settle, then what they settled on is held with other chance."""
    plant = SimulatedTurtles.drawn(seed)
    environment = TopicEnvironment(plant, clamp=SafetyClamp(plant.groups))
    follower = NetworkFollower(environment, policy)
    run_episode(environment, follower.choose, follower.told)
    learners = {group: LoopLearner(topics, learns=False) for group, topics in plant.groups.items()}
    for group, settings in follower.settled.items():
        learners[group].best = settings

    def world() -> SimulatedTurtles:
        again = SimulatedTurtles.drawn(seed)
        again.restart(UNSEEN + seed)
        return again

    return against(world, lambda fresh: hold(fresh, learners), seed)


def hold(plant: SimulatedTurtles, learners: Mapping[str, LoopLearner]) -> Episode:
    """An episode of learners that have learnt, with the safety clamp."""
    for learner in learners.values():
        learner.learns = False
    return train(TopicEnvironment(plant, clamp=SafetyClamp(plant.groups)), learners, 1)[0]


def trial_lines(
    policy: NetworkPolicy, seeds: Iterable[int] = range(UNSEEN, UNSEEN + 5)
) -> list[str]:
    """Median and worst of trials, as a table for people."""
    outcomes = [try_network(policy, seed) for seed in seeds]
    rows = (
        ("MOS of the worse turtle", "mos", 1.0),
        ("speed against the original, slower turtle", "speed", 1.0),
        ("request saved, by QoS class (%)", "saved_by_class", 100.0),
        ("request saved, by requirement (%)", "saved_by_requirement", 100.0),
        ("paper's reward over the untrained policy", "paper_over_untrained", 1.0),
    )
    lines = [f"{'turtles it has not seen (SIMULATED)':42} {'median':>8} {'worst':>8}"]
    for title, name, scale in rows:
        values = [scale * float(getattr(one, name)) for one in outcomes]
        lines.append(f"{title:42} {median(values):8.4f} {min(values):8.4f}")
    taken = [one.reverted for one in outcomes]
    lines.append(f"{'settings taken back by the clamp':42} {median(taken):8.4f} {max(taken):8.4f}")
    return lines
