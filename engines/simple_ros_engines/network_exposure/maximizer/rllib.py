"""Ray RLlib on the maximizer's environments (multi-agent, an agent for each topic), and its policies as files without ray.

``pip install 'simple-ros[learning-rllib]'``. RLlib spreads the environments over its runners, on one machine or many.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from simple_ros.errors import ConfigError
from simple_ros_engines.network_exposure.maximizer.environment import TopicEnvironment
from simple_ros_engines.network_exposure.maximizer.network import Network, NetworkPolicy
from simple_ros_engines.network_exposure.maximizer.wrappers import imported, parallel_env

__all__ = ["module_for", "multi_agent_env", "policy_of"]

_EXTRA = "learning-rllib"


def multi_agent_env(environment: TopicEnvironment) -> Any:
    """A ``ray.rllib.env.multi_agent_env.MultiAgentEnv`` of all topics.

    Raises:
        ExtraMissing: RLlib is not installed.
    """
    wrapped = imported("ray.rllib.env.wrappers.pettingzoo_env", _EXTRA).ParallelPettingZooEnv
    return wrapped(parallel_env(environment))


def module_for(agent: str, *_: Any, **__: Any) -> str:
    """RLlib's policy mapping: topics with the same last part (pose, cmd_vel) learn together."""
    return agent.rpartition("/")[2]


def policy_of(modules: Mapping[str, Any], made_by: str = "ray rllib") -> NetworkPolicy:
    """What the default torch modules of PPO learnt, for `network_text`.

    Args:
        modules: By last part of the topic, or `ANY_TOPIC`.
        made_by: For readers of the file.

    Raises:
        ConfigError: A module is not made of an encoder and a head of linear layers.
    """
    return NetworkPolicy({name: _network(one) for name, one in modules.items()}, made_by)


def _network(module: Any) -> Network:
    encoder = getattr(module, "encoder", None)
    actor = getattr(encoder, "actor_encoder", None) or getattr(encoder, "encoder", None)
    if actor is None or not hasattr(module, "pi"):
        raise ConfigError(f"{type(module).__name__} has no encoder and head as PPO's default has")
    parts = [*actor.modules(), *module.pi.modules()]
    layers = [one for one in parts if type(one).__name__ == "Linear"]
    between = {type(one).__name__.lower() for one in parts} & {"tanh", "relu", "silu"}
    if len(between) > 1:
        raise ConfigError(f"layers with different activations between them: {sorted(between)}")
    weights = [
        (one.weight.detach().cpu().numpy(), one.bias.detach().cpu().numpy()) for one in layers
    ]
    return Network(weights, next(iter(between), "tanh"))
