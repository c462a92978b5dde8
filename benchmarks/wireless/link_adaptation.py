"""Link adaptation against a genie that knows the channel and the true error curves of each slot.

SIMULATED. `python benchmarks/wireless/link_adaptation.py [--seeds 20]`
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from common import Column, arguments, print_parameters, print_table

from simple_ros_engines.forecasting import LinearForecaster
from simple_ros_engines.physical_adaptive.link_adaptation import (
    LinkAdapter,
    OuterLoop,
    feedback_step,
)
from simple_ros_engines.radio.bler import best_mcs
from simple_ros_engines.radio.mcs import McsTable, mcs_table
from simple_ros_engines.simulator.propagation import Fading, Shadowing, effective_snr_db
from simple_ros_engines.simulator.radio import HiddenCurves

TABLE = McsTable.QAM64
MEMORY = 1000.0
LOOP = OuterLoop(0.1, step_up_db=0.01)
EFFICIENCY = [mcs.efficiency for mcs in mcs_table(TABLE)]


@dataclass(frozen=True)
class Setup:
    """Parameters of the generator."""

    slot_s: float = 0.0005
    slots: int = 40_000
    report_every_slots: int = 1
    report_delay_slots: int = 4
    ack_delay_slots: int = 4
    report_noise_db: float = 0.5
    mean_snr_db: tuple[float, float] = (4.0, 16.0)
    shadow_sigma_db: float = 4.0
    shadow_correlation_m: float = 13.0
    warm_up_slots: int = 2_000
    most_offset_db: float = 2.0


SCENARIOS = {
    "walking, 8 antennas": Fading(1.4, antennas=8),
    "driving, 8 antennas": Fading(13.9, antennas=8),
    "driving, 4 antennas (no bar: more fading than any late report can follow)": Fading(13.9),
}


def channel(setup: Setup, fading: Fading, rng: np.random.Generator) -> np.ndarray:
    times = np.arange(setup.slots) * setup.slot_s
    shadow = Shadowing(rng, setup.shadow_sigma_db, setup.shadow_correlation_m)
    every = 200
    step_m = fading.speed_mps * setup.slot_s * every
    points = [shadow.moved(step_m) for _ in range(setup.slots // every + 2)]
    slow = np.interp(np.arange(setup.slots) / every, np.arange(len(points)), points)
    mean = rng.uniform(*setup.mean_snr_db) + slow
    return effective_snr_db(mean, fading.trace(rng, times))


class Ours:
    """Filtered reports, the inner and the outer loop."""

    def __init__(self, loop: OuterLoop, setup: Setup) -> None:
        ahead = -(-setup.report_delay_slots // setup.report_every_slots)
        self.filter, self.adapter = LinearForecaster(ahead, MEMORY), LinkAdapter(TABLE, loop)
        self.last, self.used = None, 0.0

    def choose(self, snr_db: float) -> int:
        if snr_db != self.last:
            self.last = snr_db
            self.used = self.filter.sample(snr_db)
        return self.adapter.choose(self.used)

    def feedback(self, arrived: float, lost: float, mcs: int) -> None:
        self.adapter.feedback(arrived, lost, mcs)


class Fixed:
    """The inner loop alone: what the model says, nothing learnt."""

    def choose(self, snr_db: float) -> int:
        return best_mcs(TABLE, snr_db, 0.1).index

    def feedback(self, arrived: float, lost: float, mcs: int) -> None:
        pass


class Steps:
    """The rule of WirelessROS on the mean of each 100 blocks."""

    def __init__(self) -> None:
        self.mcs, self.lost, self.count = 0, 0.0, 0

    def choose(self, snr_db: float) -> int:
        if self.count >= 100:
            self.mcs = feedback_step(TABLE, self.mcs, self.lost / self.count, snr_db, 1.0)
            self.lost, self.count = 0.0, 0
        return self.mcs

    def feedback(self, arrived: float, lost: float, mcs: int) -> None:
        self.lost += lost
        self.count += 1


def run(adapter, setup: Setup, snrs, reports, curves: HiddenCurves, draws) -> tuple[float, float]:
    """Mean goodput, and share of blocks lost above the lowest scheme."""
    pending: list[tuple[int, float, float, int]] = []
    mcs, got, lost_count, counted, adapted = 0, 0.0, 0, 0, 0
    head = 0
    for slot in range(setup.slots):
        while head < len(pending) and pending[head][0] <= slot:
            _, arrived, lost, used = pending[head]
            adapter.feedback(arrived, lost, used)
            head += 1
        mcs = adapter.choose(reports[slot])
        is_lost = draws[slot] < curves.bler(mcs, snrs[slot])
        pending.append((slot + setup.ack_delay_slots, float(not is_lost), float(is_lost), mcs))
        if slot >= setup.warm_up_slots:
            counted += 1
            got += 0.0 if is_lost else EFFICIENCY[mcs]
            # Below the lowest scheme nobody can hold a target.
            if mcs > 0:
                adapted += 1
                lost_count += is_lost
    return got / counted, lost_count / max(1, adapted)


def one_seed(seed: int, setup: Setup, fading: Fading) -> list[float]:
    rng = np.random.default_rng(seed)
    curves = HiddenCurves.drawn(rng, TABLE, setup.most_offset_db)
    snrs = channel(setup, fading, rng)
    noise = rng.normal(0, setup.report_noise_db, setup.slots)
    slots = np.arange(setup.slots)
    measured = slots - slots % setup.report_every_slots - setup.report_delay_slots
    reports = (snrs[np.maximum(0, measured)] + noise[slots // setup.report_every_slots]).tolist()
    draws = rng.random(setup.slots).tolist()
    best = [float(curves.goodputs(snr).max()) for snr in snrs[setup.warm_up_slots :]]
    genie = sum(best) / len(best)
    values = snrs.tolist()
    ours = run(Ours(LOOP, setup), setup, values, reports, curves, draws)
    fixed = run(Fixed(), setup, values, reports, curves, draws)
    steps = run(Steps(), setup, values, reports, curves, draws)
    return [
        100 * ours[0] / genie,
        100 * ours[1],
        100 * max(fixed[0], steps[0]) / genie,
        100 * fixed[0] / genie,
        100 * steps[0] / genie,
        abs(curves.offset_db),
    ]


COLUMNS = [
    Column("ours, of genie", "%", min, "bar: >= 90"),
    Column("ours, blocks lost", "%", lambda v: max(v, key=lambda x: abs(x - 10)), "bar: 8..12"),
    Column("best simple, of genie", "%", min),
    Column("inner loop alone, of genie", "%", min),
    Column("rule of WirelessROS, of genie", "%", min),
    Column("hidden offset, absolute", "dB", max),
]


def main() -> None:
    options = arguments(__doc__ or "")
    setup = Setup()
    for name, fading in SCENARIOS.items():
        print_parameters(f"uplink adaptation, {name} (SIMULATED)", setup, fading, LOOP)
        rows = [one_seed(seed, setup, fading) for seed in range(1, options.seeds + 1)]
        print_table(COLUMNS, rows, options.verbose)


if __name__ == "__main__":
    main()
