"""Train the maximizer's policies with Ray RLlib's multi-agent PPO and save them so that the maximizer needs neither ray nor torch.

Takes minutes. ``pip install 'simple-ros[learning-rllib]'``, then

    python examples/learning/rllib_maximizer.py --policy policy.json
    SIMPLE_ROS_ARGS="_policy:=$PWD/policy.json" simple-ros engine run maximizer

Each topic is an agent; poses share a policy, commands share another. Each runner has turtles of its own. To train on many
machines start ray on them (``ray start --head``, ``ray start --address=...``) with simple-ros installed, and say
``--address auto --runners 32``.
"""

import argparse
import json
import time
from pathlib import Path

import ray
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from ray.tune.registry import register_env

from simple_ros_engines.network_exposure.maximizer.clamp import SafetyClamp
from simple_ros_engines.network_exposure.maximizer.environment import TopicEnvironment
from simple_ros_engines.network_exposure.maximizer.plant import SimulatedTurtles
from simple_ros_engines.network_exposure.maximizer.policy_file import network_text
from simple_ros_engines.network_exposure.maximizer.rllib import (
    module_for,
    multi_agent_env,
    policy_of,
)
from simple_ros_engines.network_exposure.maximizer.training import scattered
from simple_ros_engines.network_exposure.maximizer.trial import trial_lines

MODULES = ("pose", "cmd_vel")


def world(config):
    """The environment of one runner."""
    seed = config["seed"] + config.worker_index
    plant = SimulatedTurtles.drawn(seed, config["turtles"])
    topics = [topic for members in plant.groups.values() for topic in members]
    return multi_agent_env(
        TopicEnvironment(
            plant, clamp=SafetyClamp(plant.groups), horizon=32, begin=scattered(topics, seed)
        )
    )


def configured(options):
    return (
        PPOConfig()
        .environment("maximizer", env_config={"seed": options.seed, "turtles": options.turtles})
        .env_runners(num_env_runners=options.runners, rollout_fragment_length="auto")
        .multi_agent(
            policies=set(MODULES), policy_mapping_fn=module_for, count_steps_by="agent_steps"
        )
        .rl_module(
            model_config=DefaultModelConfig(
                fcnet_hiddens=[32, 32], fcnet_activation="tanh", vf_share_layers=False
            )
        )
        .training(
            gamma=0.9,
            lambda_=0.9,
            lr=1e-3,
            train_batch_size_per_learner=options.batch * 2 * options.turtles,
            minibatch_size=256,
            num_epochs=8,
            entropy_coeff=0.0,
            use_kl_loss=False,
            clip_param=0.2,
            vf_clip_param=100.0,
        )
        .debugging(seed=options.seed, log_level="ERROR")
    )


def point(result, options):
    """What Fig. 14 of the paper shows: mean reward, loss and entropy of the policies."""
    learners = [result["learners"][name] for name in MODULES]
    runners = result["env_runners"]
    agents = 2 * options.turtles
    rewards = runners.get("agent_episode_returns_mean", {})
    length = runners.get("episode_len_mean", float("nan"))
    return {
        "decisions": int(runners["num_env_steps_sampled_lifetime"]) * agents,
        "reward": float(sum(rewards.values())) / max(1, len(rewards)) / length,
        "entropy": sum(float(one["entropy"]) for one in learners) / len(learners),
        "policy_loss": sum(float(one["policy_loss"]) for one in learners) / len(learners),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=80, help="improvements of the policies")
    parser.add_argument("--batch", type=int, default=64, help="decisions of each agent a round")
    parser.add_argument("--turtles", type=int, default=8, help="of each runner")
    parser.add_argument("--runners", type=int, default=0, help="processes; 0 is this one alone")
    parser.add_argument("--address", help="of a ray cluster; else ray runs on this machine only")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--policy", type=Path, default=Path("policy.json"), help="written")
    parser.add_argument("--curve", type=Path, help="written: the training in numbers, as JSON")
    options = parser.parse_args()
    register_env("maximizer", world)
    ray.init(address=options.address, include_dashboard=False, log_to_driver=False)
    algorithm = configured(options).build_algo()
    points = []
    begun = time.perf_counter()
    for _ in range(options.rounds):
        points.append(point(algorithm.train(), options))
        print("{decisions:8d} decisions, reward {reward:6.3f}".format(**points[-1]))
    print(f"trained for {time.perf_counter() - begun:.0f} s")
    policy = policy_of({name: algorithm.get_module(name) for name in MODULES}, "ray rllib PPO")
    options.policy.write_text(network_text(policy))
    if options.curve is not None:
        options.curve.write_text(json.dumps(points))
    algorithm.stop()
    ray.shutdown()
    print(*trial_lines(policy), sep="\n")


if __name__ == "__main__":
    main()
