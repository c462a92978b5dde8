"""Stable-Baselines3 on the maximizer's environments, and policies it trained as files that need neither it nor torch.

``pip install 'simple-ros[learning-sb3]'``. All topics of all environments are columns of one vectorised environment, so one
policy is learnt from all of them and for all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from simple_ros.errors import ConfigError
from simple_ros_engines.network_exposure.maximizer.environment import TopicEnvironment
from simple_ros_engines.network_exposure.maximizer.network import ANY_TOPIC, Network, NetworkPolicy
from simple_ros_engines.network_exposure.maximizer.wrappers import imported, parallel_env

__all__ = ["policy_of", "vec_env"]

_EXTRA = "learning-sb3"


def vec_env(environments: Sequence[TopicEnvironment]) -> Any:
    """A ``stable_baselines3.common.vec_env.VecEnv`` with a column for each topic of each environment.

    Raises:
        ExtraMissing: Stable-Baselines3 is not installed.
        ConfigError: There is no environment.
    """
    base = imported("stable_baselines3.common.vec_env", _EXTRA).VecEnv
    if not environments:
        raise ConfigError("nothing to train on: no environment")
    return type("TopicsVecEnv", (_Columns, base), {})(environments)


def policy_of(model: Any, made_by: str = "stable-baselines3") -> NetworkPolicy:
    """What a model learnt that has an ``MlpPolicy`` (PPO, A2C), for `network_text`.

    Raises:
        ConfigError: It has another policy, or another activation than tanh or relu.
    """
    policy = model.policy
    extractor = getattr(policy, "mlp_extractor", None)
    if extractor is None or not hasattr(policy, "action_net"):
        raise ConfigError(f"{type(policy).__name__} is no actor with layers, as of MlpPolicy")
    linear = [one for one in extractor.policy_net if hasattr(one, "weight")]
    activation = policy.activation_fn.__name__.lower()
    layers = [_numbers(one) for one in (*linear, policy.action_net)]
    return NetworkPolicy({ANY_TOPIC: Network(layers, activation)}, made_by)


class _Columns:
    """What ``VecEnv`` asks for. The topics of an environment begin and end their episodes together."""

    def __init__(self, environments: Sequence[TopicEnvironment]) -> None:
        self._worlds = [parallel_env(one) for one in environments]
        self._agents = [(w, agent) for w in self._worlds for agent in w.possible_agents]
        world, agent = self._agents[0]
        spaces = world.observation_space(agent), world.action_space(agent)
        super().__init__(len(self._agents), *spaces)  # type: ignore[call-arg]
        self._actions: Any = None
        self._gained = np.zeros(len(self._agents))
        self._length = 0

    def reset(self) -> Any:
        """Begin an episode everywhere; seeds given to ``seed`` begin simulated processes anew."""
        seeds = getattr(self, "_seeds", [])
        firsts = [self._agents.index((w, w.possible_agents[0])) for w in self._worlds]
        seen = []
        for world, first in zip(self._worlds, firsts, strict=True):
            got, _ = world.reset(seed=seeds[first] if first < len(seeds) else None)
            seen += [got[agent] for agent in world.possible_agents]
        self._gained[:] = 0
        self._length = 0
        self._reset_seeds()  # type: ignore[attr-defined]
        return np.stack(seen)

    def step_async(self, actions: Any) -> None:
        """Keep what the topics are to do."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, Any, Any, list[dict[str, Any]]]:
        """Do it. An environment whose episode is over begins the next one at once."""
        seen: list[Any] = []
        rewards: list[float] = []
        ends: list[bool] = []
        facts: list[dict[str, Any]] = []
        rest = iter(self._actions)
        for world in self._worlds:
            names = world.possible_agents
            got, gained, _, over, told = world.step({name: next(rest) for name in names})
            is_over = any(over.values())
            following = world.reset()[0] if is_over else got
            for name in names:
                fact = dict(told[name])
                if is_over:
                    fact |= {"terminal_observation": got[name], "TimeLimit.truncated": True}
                seen.append(following[name])
                rewards.append(gained[name])
                ends.append(is_over)
                facts.append(fact)
        self._note_episodes(rewards, ends, facts)
        return np.stack(seen), np.array(rewards, dtype=np.float32), np.array(ends), facts

    def close(self) -> None:
        """Nothing to close: processes go on."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of the worlds that columns belong to."""
        return [getattr(self._agents[index][0], attr_name, None) for index in self._of(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set it."""
        for index in self._of(indices):
            setattr(self._agents[index][0], attr_name, value)

    def env_method(
        self, method_name: str, *args: Any, indices: Any = None, **options: Any
    ) -> list[Any]:
        """Call a method of the worlds that columns belong to."""
        worlds = [self._agents[index][0] for index in self._of(indices)]
        return [getattr(world, method_name)(*args, **options) for world in worlds]

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Whether the worlds that columns belong to are of this class."""
        return [isinstance(self._agents[index][0], wrapper_class) for index in self._of(indices)]

    def _of(self, indices: Any) -> list[int]:
        if indices is None:
            return list(range(len(self._agents)))
        return [indices] if isinstance(indices, int) else list(indices)

    def _note_episodes(
        self, rewards: list[float], ends: list[bool], facts: list[dict[str, Any]]
    ) -> None:
        """What Stable-Baselines3 prints as mean reward and length of episodes."""
        self._gained += rewards
        self._length += 1
        for index, is_over in enumerate(ends):
            if is_over:
                facts[index]["episode"] = {"r": float(self._gained[index]), "l": self._length}
                self._gained[index] = 0
        if all(ends):
            self._length = 0


def _numbers(layer: Any) -> tuple[Any, Any]:
    return layer.weight.detach().cpu().numpy(), layer.bias.detach().cpu().numpy()
