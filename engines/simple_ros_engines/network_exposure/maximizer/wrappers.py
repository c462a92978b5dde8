"""The environment for other people's algorithms: Gymnasium (one topic) and PettingZoo (all of them).

Both packages are optional: ``pip install 'simple-ros[learning]'``. Episodes end by truncation only; the process goes on, and
``reset`` puts no knob back, so the value of what follows counts as the paper's settings have it. ``reset(seed=...)`` begins a
simulated process anew; live topics go on, and the environment says of itself that it is not deterministic.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from simple_ros.errors import SimpleRosError
from simple_ros_engines.network_exposure.maximizer.environment import (
    OBSERVATION_SIZE,
    TopicEnvironment,
)
from simple_ros_engines.network_exposure.maximizer.knobs import KNOBS, Action, Setting
from simple_ros_engines.network_exposure.maximizer.plant import Repeatable

__all__ = ["ExtraMissing", "gymnasium_env", "imported", "parallel_env"]

_ID = "simple_ros/MaximizerTopic-v1"
Others = Callable[[Mapping[str, Setting]], dict[str, Action]]
"""What the other topics do."""


class ExtraMissing(SimpleRosError, ImportError):
    """A package is needed that is not installed.

    Attributes:
        package: Its name.
        extra: Of simple-ros; brings it.
    """

    def __init__(self, package: str, extra: str = "learning") -> None:
        self.package = package
        self.extra = extra
        super().__init__(
            f"{package} is not installed; the agent that comes with the maximizer needs nothing, for "
            f"others: pip install 'simple-ros[{extra}]'"
        )


def gymnasium_env(environment: TopicEnvironment, topic: str, others: Others | None = None) -> Any:
    """A ``gymnasium.Env`` of one topic.

    Args:
        environment: Of all topics.
        topic: The agent's.
        others: What the other topics do; None leaves them as they are.

    Raises:
        ExtraMissing: Gymnasium is not installed.
        LookupError: There is no such topic.
    """
    gymnasium = imported("gymnasium")
    if topic not in environment.agents:
        raise LookupError(f"no topic {topic!r}; there are {', '.join(environment.agents)}")
    made = type("TopicEnv", (_OneTopic, gymnasium.Env), {"metadata": {"render_modes": []}})

    def again() -> Any:
        return made(environment, topic, others, *_spaces(gymnasium))

    env = again()
    env.spec = gymnasium.envs.registration.EnvSpec(
        _ID,
        again,
        nondeterministic=not isinstance(environment.plant, Repeatable),
        order_enforce=False,
        disable_env_checker=True,
    )
    return env


def parallel_env(environment: TopicEnvironment) -> Any:
    """A ``pettingzoo.ParallelEnv`` of all topics.

    Raises:
        ExtraMissing: PettingZoo or Gymnasium is not installed.
    """
    gymnasium, pettingzoo = imported("gymnasium"), imported("pettingzoo")
    metadata = {"name": "network_exposure_maximizer_v1", "render_modes": []}
    made = type("TopicsEnv", (_AllTopics, pettingzoo.ParallelEnv), {"metadata": metadata})
    return made(environment, *_spaces(gymnasium))


class _OneTopic:
    """What ``gymnasium.Env`` asks for."""

    def __init__(
        self, environment: TopicEnvironment, topic: str, others: Others | None, seen: Any, acts: Any
    ) -> None:
        self.environment = environment
        self.topic = topic
        self.observation_space, self.action_space = seen, acts
        self._others = others

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode; ``options={"settings": {...}}`` puts the knobs of all topics."""
        super().reset(seed=seed)  # type: ignore[misc]
        seen = self.environment.reset((options or {}).get("settings"), seed)
        return seen[self.topic], {}

    def step(self, action: Sequence[int]) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Turn the knobs: 0 is a notch down, 1 none, 2 a notch up."""
        actions = {} if self._others is None else self._others(self.environment.settings)
        actions[self.topic] = _action(action)
        step = self.environment.step(actions)
        facts = {"mos": step.seen[self.topic].mos, "reverted": bool(step.reverted)}
        return (
            step.observations[self.topic],
            step.rewards[self.topic],
            False,
            step.is_truncated,
            facts,
        )


class _AllTopics:
    """What ``pettingzoo.ParallelEnv`` asks for."""

    def __init__(self, environment: TopicEnvironment, seen: Any, acts: Any) -> None:
        self.environment = environment
        self.possible_agents = environment.agents
        self.agents: list[str] = []
        self.observation_spaces = dict.fromkeys(self.possible_agents, seen)
        self.action_spaces = dict.fromkeys(self.possible_agents, acts)

    def observation_space(self, agent: str) -> Any:
        """Of one topic."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Any:
        """Of one topic."""
        return self.action_spaces[agent]

    def reset(
        self,
        seed: int | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin an episode; ``options={"settings": {...}}`` puts the knobs."""
        self.agents = list(self.possible_agents)
        seen = self.environment.reset((options or {}).get("settings"), seed)
        return dict(seen), {agent: {} for agent in self.agents}

    def step(self, actions: Mapping[str, Sequence[int]]) -> tuple[dict[str, Any], ...]:
        """Turn the knobs of all: 0 is a notch down, 1 none, 2 a notch up."""
        step = self.environment.step({agent: _action(one) for agent, one in actions.items()})
        agents = self.agents
        facts = {
            agent: {"mos": step.seen[agent].mos, "reverted": bool(step.reverted)}
            for agent in agents
        }
        ends = dict.fromkeys(agents, step.is_truncated)
        if step.is_truncated:
            self.agents = []
        return step.observations, step.rewards, dict.fromkeys(agents, False), ends, facts


def imported(name: str, extra: str = "learning") -> Any:
    """A module of a package that an extra brings.

    Raises:
        ExtraMissing: It is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        raise ExtraMissing(name.partition(".")[0], extra) from None


def _spaces(gymnasium: Any) -> tuple[Any, Any]:
    seen = gymnasium.spaces.Box(0.0, 1.0, (OBSERVATION_SIZE,), np.float32)
    return seen, gymnasium.spaces.MultiDiscrete([3] * len(KNOBS))


def _action(given: Sequence[int]) -> Action:
    delay, drop, speed = (int(part) - 1 for part in given)
    return delay, drop, speed
