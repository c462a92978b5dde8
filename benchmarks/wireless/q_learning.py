"""Q-learning on top of a heuristic, against the heuristic alone on the same channel.

The heuristic is link adaptation with inner and outer loop and a target: 10 % of blocks, which is best for throughput, or
0.5 %, which suits the reward. That is `strategy.score` of what really happened. Beside them stand the best fixed target of
that seed, chosen in hindsight, and what is attainable by who knows the true error curves. SIMULATED.
`python benchmarks/wireless/q_learning.py [--seeds 20]`
"""

from __future__ import annotations

import random
from dataclasses import dataclass
from functools import partial

import numpy as np
from common import Column, arguments, by_seed, print_parameters, print_table

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
TARGETS = (0.1, 0.05, 0.03, 0.02, 0.01, 0.005, 0.002)
USUAL, SUITED = 0.1, 0.005
FOLLOWS = 3
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


class Heuristic:
    """Inner and outer loop; a tenth of a decibel for five lost blocks more than the target, whatever that is."""

    def __init__(self, target: float, blocks: int) -> None:
        self.adapter = LinkAdapter(TABLE, OuterLoop(target, 0.02 * target))
        self._blocks = blocks

    def pick(self, snr_db: float, bler: float) -> int:
        return self.adapter.choose(snr_db)

    def heard(self, reward: float, bler: float) -> None:
        self.adapter.feedback(self._blocks * (1 - bler), self._blocks * bler)


class Learning:
    """The learner's corrections of a heuristic."""

    def __init__(self, heuristic: Heuristic, settings: QSettings, seed: int) -> None:
        self._heuristic = heuristic
        self._learner = QLearner(ACTIONS, FOLLOWS, settings)
        self._draw = random.Random(seed)
        self._held: tuple | None = None
        self._reward = 0.0

    def pick(self, snr_db: float, bler: float) -> int:
        state = discretize_state(snr_db, bler, 0.0, 0.5)
        if self._held is not None:
            self._learner.learn(*self._held, self._reward, state)
        wanted = self._learner.choose(state, self._draw)
        base = self._heuristic.pick(snr_db, bler)
        mcs = min(LAST, max(0, base + ACTIONS[wanted][0]))
        # What is learnt from is what was applied, not what was wanted.
        self._held = (state, ACTIONS.index((mcs - base,)))
        return mcs

    def heard(self, reward: float, bler: float) -> None:
        self._reward = reward
        if self._held is not None and self._held[1] == FOLLOWS:
            # The outer loop learns only from blocks that were sent as it said.
            self._heuristic.heard(reward, bler)


class Rule:
    """The rule of WirelessROS."""

    def __init__(self) -> None:
        self.mcs = 0

    def pick(self, snr_db: float, bler: float) -> int:
        self.mcs = feedback_step(TABLE, self.mcs, bler, snr_db, 1.0)
        return self.mcs

    def heard(self, reward: float, bler: float) -> None:
        pass


class Knowing:
    """The scheme of the greatest expected reward, by the true error curves and the noise of reports."""

    def __init__(self, setup: Setup, curves: HiddenCurves) -> None:
        efficiency = np.array([mcs.efficiency for mcs in mcs_table(TABLE)])
        carrier = Carrier(30, 51)
        self._best = []
        for snr_db in np.arange(-20, 50, 0.1):
            values = np.zeros(efficiency.size)
            for z in np.linspace(-2.5, 2.5, 11):
                arrives = curves.goodputs(snr_db + z * setup.report_noise_db) / efficiency
                values += np.exp(-(z**2) / 2) * np.array(
                    [reward_of(setup, carrier, mcs, 1 - a) for mcs, a in enumerate(arrives)]
                )
            self._best.append(int(values.argmax()))

    def pick(self, snr_db: float, bler: float) -> int:
        return self._best[min(len(self._best) - 1, max(0, round((snr_db + 20) * 10)))]

    def heard(self, reward: float, bler: float) -> None:
        pass


def reward_of(setup: Setup, carrier: Carrier, mcs: int, bler: float) -> float:
    arrived = mcs_table(TABLE)[mcs].efficiency * (1 - bler)
    carried = min(setup.offered_bps, carrier.rate_bps(arrived))
    return score(bler, arrived, carried, setup.offered_bps)


@dataclass(frozen=True)
class Channel:
    """What everybody is tried on."""

    setup: Setup
    curves: HiddenCurves
    snrs: np.ndarray
    reports: list[float]
    seed: int

    def rewards(self, who) -> np.ndarray:
        """Reward by step; the first report of a share lost is a tenth."""
        setup, carrier = self.setup, Carrier(30, 51)
        rng = np.random.default_rng(1000 + self.seed)
        rewards, bler = np.zeros(setup.steps), 0.1
        for step, report in enumerate(self.reports):
            mcs = who.pick(report, bler)
            chance = self.curves.bler(mcs, self.snrs[step])
            bler = rng.binomial(setup.blocks_per_step, chance) / setup.blocks_per_step
            rewards[step] = reward_of(setup, carrier, mcs, bler)
            who.heard(rewards[step], bler)
        return rewards


def channel(seed: int, setup: Setup) -> Channel:
    rng = np.random.default_rng(seed)
    curves = HiddenCurves.drawn(rng, TABLE)
    shadow = Shadowing(rng, setup.shadow_sigma_db, setup.shadow_correlation_m)
    mean = rng.uniform(*setup.mean_snr_db)
    snrs = np.array([mean + shadow.moved(setup.speed_mps * 0.1) for _ in range(setup.steps)])
    snrs += rng.normal(0, setup.fast_sigma_db, setup.steps)
    reports = (snrs + rng.normal(0, setup.report_noise_db, setup.steps)).tolist()
    return Channel(setup, curves, snrs, reports, seed)


def one_seed(seed: int, setup: Setup, settings: QSettings) -> list[float]:
    tried, blocks, half = channel(seed, setup), setup.blocks_per_step, setup.steps // 2
    plain = {target: tried.rewards(Heuristic(target, blocks)) for target in TARGETS}
    result = []

    def over(one: np.ndarray, other: np.ndarray) -> float:
        return 100 * (one[half:].mean() / other[half:].mean() - 1)

    def worst_window(one: np.ndarray, other: np.ndarray) -> float:
        windows = [rewards.reshape(-1, setup.window).mean(1) for rewards in (one, other)]
        return float(100 * (windows[0] / windows[1] - 1).min())

    best = max(plain.values(), key=lambda rewards: rewards[half:].mean())
    for target in (USUAL, SUITED):
        ours = tried.rewards(Learning(Heuristic(target, blocks), settings, seed))
        result += [over(ours, plain[target]), worst_window(ours, plain[target]), over(ours, best)]
    result.append(over(best, plain[USUAL]))
    result.append(over(tried.rewards(Rule()), plain[USUAL]))
    result.append(over(tried.rewards(Knowing(setup, tried.curves)), best))
    return result


COLUMNS = [
    Column("on a target of 10 %: ours against it, second half", "%", min, "bar: > 0"),
    Column("  worst window while training", "%", min, "bar: >= -5"),
    Column("  ours against the best fixed target", "%", min),
    Column("on a target of 0.5 %: ours against it, second half", "%", min, "bar: > 0"),
    Column("  worst window while training", "%", min, "bar: >= -5"),
    Column("  ours against the best fixed target", "%", min),
    Column("best simple (best fixed target) against 10 %", "%", min),
    Column("rule of WirelessROS against 10 %", "%", min),
    Column("attainable against the best fixed target", "%", min),
]


def main() -> None:
    options = arguments(__doc__ or "")
    setup, settings = Setup(), QSettings()
    print_parameters("Q-learning (SIMULATED)", setup, settings, actions=ACTIONS, targets=TARGETS)
    rows = by_seed(partial(one_seed, setup=setup, settings=settings), options)
    print_table(COLUMNS, rows, options.verbose)


if __name__ == "__main__":
    main()
