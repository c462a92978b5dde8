"""Q-learning on top of the heuristic, against the heuristic alone on the same channel.

The heuristic is link adaptation with inner and outer loop, target 10 % of blocks. The reward is `strategy.score` of what really
happened. SIMULATED. `python benchmarks/wireless/q_learning.py [--seeds 20]`
"""

from __future__ import annotations

import random
from dataclasses import dataclass

import numpy as np
from common import Column, arguments, print_parameters, print_table

from simple_ros_engines.physical_adaptive.link_adaptation import (
    LinkAdapter,
    OuterLoop,
    feedback_step,
)
from simple_ros_engines.physical_adaptive.q_learning import QLearner, QSettings, discretize_state
from simple_ros_engines.physical_adaptive.strategy import score
from simple_ros_engines.radio.carrier import Carrier
from simple_ros_engines.radio.mcs import McsTable, mcs_table
from simple_ros_engines.simulator.propagation import Shadowing
from simple_ros_engines.simulator.radio import HiddenCurves

TABLE = McsTable.QAM64
LAST = len(mcs_table(TABLE)) - 1
LOOP_STEP_DB = 0.002
ACTIONS = [(delta,) for delta in range(-3, 4)]


@dataclass(frozen=True)
class Setup:
    """Parameters of the generator; a step is 0.1 s."""

    steps: int = 20_000
    blocks_per_step: int = 50
    speed_mps: float = 1.4
    mean_snr_db: tuple[float, float] = (6.0, 16.0)
    shadow_sigma_db: float = 4.0
    shadow_correlation_m: float = 13.0
    fast_sigma_db: float = 0.5
    report_noise_db: float = 0.5
    window: int = 500
    offered_bps: float = 20e6


def run(pick, learn, setup, snrs, reports, curves, seed) -> np.ndarray:
    rng = np.random.default_rng(1000 + seed)
    carrier = Carrier(30, 51)
    rewards = np.zeros(setup.steps)
    bler = 0.1
    for step in range(setup.steps):
        mcs = pick(reports[step], bler)
        truth = curves.bler(mcs, snrs[step])
        bler = rng.binomial(setup.blocks_per_step, truth) / setup.blocks_per_step
        efficiency = mcs_table(TABLE)[mcs].efficiency
        carried = min(setup.offered_bps, carrier.rate_bps(efficiency * (1 - bler)))
        rewards[step] = score(bler, efficiency * (1 - bler), carried, setup.offered_bps)
        learn(rewards[step], bler, step)
    return rewards


def one_seed(seed: int, setup: Setup, settings: QSettings) -> list[float]:
    rng = np.random.default_rng(seed)
    curves = HiddenCurves.drawn(rng, TABLE)
    shadow = Shadowing(rng, setup.shadow_sigma_db, setup.shadow_correlation_m)
    mean = rng.uniform(*setup.mean_snr_db)
    snrs = np.array([mean + shadow.moved(setup.speed_mps * 0.1) for _ in range(setup.steps)])
    snrs += rng.normal(0, setup.fast_sigma_db, setup.steps)
    reports = (snrs + rng.normal(0, setup.report_noise_db, setup.steps)).tolist()

    blocks = setup.blocks_per_step
    adapter, alone = (LinkAdapter(TABLE, OuterLoop(0.1, LOOP_STEP_DB)) for _ in range(2))

    learner, generator = QLearner(ACTIONS, 3, settings), random.Random(seed)
    held: dict = {}

    def pick(snr_db: float, bler: float) -> int:
        state = discretize_state(snr_db, bler, 0.0, 0.5)
        if held:
            learner.learn(held["state"], held["action"], held["reward"], state)
        action = learner.choose(state, generator)
        base = adapter.choose(snr_db)
        mcs = min(LAST, max(0, base + ACTIONS[action][0]))
        # What is learnt from is what was applied, not what was wanted.
        held.update(state=state, action=ACTIONS.index((mcs - base,)))
        return mcs

    def learn(reward: float, bler: float, step: int) -> None:
        held["reward"] = reward
        if held["action"] == 3:
            # The outer loop learns only from blocks that were sent as it said.
            adapter.feedback(blocks * (1 - bler), blocks * bler)

    class Steps:
        mcs = 0

        def pick(self, snr_db: float, bler: float) -> int:
            self.mcs = feedback_step(TABLE, self.mcs, bler, snr_db, 1.0)
            return self.mcs

    ours = run(pick, learn, setup, snrs, reports, curves, seed)
    heuristic = lambda snr_db, _: alone.choose(snr_db)  # noqa: E731
    heard = lambda _, bler, __: alone.feedback(blocks * (1 - bler), blocks * bler)  # noqa: E731
    plain = run(heuristic, heard, setup, snrs, reports, curves, seed)
    rule = run(Steps().pick, lambda *_: None, setup, snrs, reports, curves, seed)
    fold = lambda values: values.reshape(-1, setup.window).mean(1)  # noqa: E731
    during = 100 * (fold(ours) / fold(plain) - 1)
    half = setup.steps // 2
    after = 100 * (ours[half:].mean() / plain[half:].mean() - 1)
    rule_after = 100 * (rule[half:].mean() / plain[half:].mean() - 1)
    return [after, during.min(), rule_after, curves.offset_db]


COLUMNS = [
    Column("ours against heuristic, second half", "%", min, "bar: > 0"),
    Column("worst window while training", "%", min, "bar: >= -5"),
    Column("rule of WirelessROS against heuristic", "%", min),
    Column("hidden offset", "dB", max),
]


def main() -> None:
    options = arguments(__doc__ or "")
    setup, settings = Setup(), QSettings()
    print_parameters("Q-learning (SIMULATED)", setup, settings, actions=ACTIONS)
    rows = [one_seed(seed, setup, settings) for seed in range(1, options.seeds + 1)]
    print_table(COLUMNS, rows, options.verbose)


if __name__ == "__main__":
    main()
