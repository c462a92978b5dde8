"""Train the maximizer's policy with Stable-Baselines3's PPO and save it so that the maximizer needs neither it nor torch.

Takes minutes. ``pip install 'simple-ros[learning-sb3]'``, then

    python examples/learning/sb3_maximizer.py --policy policy.json
    SIMPLE_ROS_ARGS="_policy:=$PWD/policy.json" simple-ros engine run maximizer

trains on simulated turtles, new ones for each world. ``--live`` takes what is relayed and judged now instead, a decision
each ``--period`` seconds; then let it run for hours.
"""

import argparse
import json
import time
from contextlib import ExitStack
from pathlib import Path

from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

from simple_ros_engines.network_exposure.maximizer.clamp import SafetyClamp
from simple_ros_engines.network_exposure.maximizer.environment import TopicEnvironment
from simple_ros_engines.network_exposure.maximizer.live_session import live_environment
from simple_ros_engines.network_exposure.maximizer.plant import SimulatedTurtles
from simple_ros_engines.network_exposure.maximizer.policy_file import network_text
from simple_ros_engines.network_exposure.maximizer.sb3 import policy_of, vec_env
from simple_ros_engines.network_exposure.maximizer.training import scattered
from simple_ros_engines.network_exposure.maximizer.trial import trial_lines

STEPS = 64  # decisions of each topic between two improvements of the policy


class Curve(BaseCallback):
    """Keeps what Fig. 14 of the paper shows: mean reward, loss and entropy of the policy."""

    def __init__(self):
        super().__init__()
        self.points = []
        self.rewards = []

    def _on_step(self):
        self.rewards.append(float(self.locals["rewards"].mean()))
        return True

    def _on_rollout_start(self):
        told = self.model.logger.name_to_value
        if self.rewards:
            self.points.append(
                {
                    "decisions": self.num_timesteps,
                    "reward": sum(self.rewards) / len(self.rewards),
                    "entropy": -told.get("train/entropy_loss", float("nan")),
                    "policy_loss": told.get("train/policy_gradient_loss", float("nan")),
                }
            )
            print("{decisions:8d} decisions, reward {reward:6.3f}".format(**self.points[-1]))
            self.rewards = []


def simulated(number):
    plant = SimulatedTurtles.drawn(seed=number)
    topics = [topic for members in plant.groups.values() for topic in members]
    return TopicEnvironment(
        plant, clamp=SafetyClamp(plant.groups), horizon=STEPS // 2, begin=scattered(topics, number)
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=70, help=f"of {STEPS} decisions")
    parser.add_argument("--worlds", type=int, default=4, help="pairs of turtles at once")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--policy", type=Path, default=Path("policy.json"), help="written")
    parser.add_argument("--curve", type=Path, help="written: the training in numbers, as JSON")
    parser.add_argument("--live", action="store_true", help="train on live topics")
    parser.add_argument("--period", type=float, default=4.0, help="of a live decision, s")
    options = parser.parse_args()
    curve = Curve()
    with ExitStack() as stack:
        if options.live:
            worlds = [stack.enter_context(live_environment(period_s=options.period))]
        else:
            worlds = [simulated(100 * options.seed + number) for number in range(options.worlds)]
        env = vec_env(worlds)
        model = PPO(
            "MlpPolicy",
            env,
            n_steps=STEPS,
            batch_size=256 if env.num_envs * STEPS % 256 == 0 else STEPS,
            n_epochs=8,
            gamma=0.9,
            gae_lambda=0.9,
            learning_rate=1e-3,
            ent_coef=0.0,
            policy_kwargs={"net_arch": [32, 32]},
            seed=options.seed,
            device="cpu",
        )
        begun = time.perf_counter()
        model.learn(options.rounds * STEPS * env.num_envs, callback=curve)
        print(f"trained for {time.perf_counter() - begun:.0f} s")
    policy = policy_of(model, "stable-baselines3 PPO")
    options.policy.write_text(network_text(policy))
    if options.curve is not None:
        options.curve.write_text(json.dumps(curve.points))
    print(*trial_lines(policy), sep="\n")


if __name__ == "__main__":
    main()
