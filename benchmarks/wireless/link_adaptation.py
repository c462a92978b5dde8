"""Link adaptation against a genie that knows the channel and the true error curves of each slot.

Between the two stands what is attainable: the best linear forecast from the same reports, fitted in hindsight over the
whole trace, with the true error curves, choosing by expected goodput. SIMULATED.
`python benchmarks/wireless/link_adaptation.py [--seeds 20]`
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from common import Column, arguments, by_seed, print_parameters, print_table, recent_means
from traces import DRIVING_MPS, WALKING_MPS, street_fading

from simple_ros_engines.forecasting import LinearForecaster
from simple_ros_engines.physical_adaptive.goodput import GoodputAdapter
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
EFFICIENCY = np.array([mcs.efficiency for mcs in mcs_table(TABLE)])


@dataclass(frozen=True)
class Setup:
    """Parameters of the generator, and of our adaptation."""

    slot_s: float = 0.0005
    slots: int = 40_000
    report_delay_slots: int = 4
    ack_delay_slots: int = 4
    report_noise_db: float = 0.5
    mean_snr_db: tuple[float, float] = (4.0, 16.0)
    shadow_sigma_db: float = 4.0
    shadow_correlation_m: float = 13.0
    warm_up_slots: int = 2_000
    most_offset_db: float = 2.0
    target_bler: float = 0.09
    memory_slots: float = 8_000
    groups: int = 8


SCENARIOS = {
    "walking 3 km/h, 4 antennas": Fading(WALKING_MPS),
    "driving 60 km/h, 4 antennas": Fading(DRIVING_MPS),
    "driving 60 km/h, 8 antennas": Fading(DRIVING_MPS, antennas=8),
    "driving 60 km/h, 4 antennas, 20 MHz, delay spread 103 ns (no bar)": street_fading(DRIVING_MPS),
}


@dataclass(frozen=True)
class Trace:
    """One channel: true and reported ratio by slot, chance of arrival by slot and scheme, and luck."""

    setup: Setup
    curves: HiddenCurves
    snr_db: np.ndarray
    reports: np.ndarray
    arrives: np.ndarray
    draws: np.ndarray

    def goodput(self, mcs: np.ndarray) -> tuple[float, float]:
        """Bits per element that arrive, and per cent of blocks lost between the ends of the table."""
        chance = self.arrives[np.arange(mcs.size), mcs]
        counted = slice(self.setup.warm_up_slots, None)
        # Below the lowest scheme and above the highest nobody can hold a target.
        adapted = (mcs[counted] > 0) & (mcs[counted] < EFFICIENCY.size - 1)
        lost = 100 * (1 - chance[counted][adapted].mean()) if adapted.any() else 0.0
        return float((EFFICIENCY[mcs] * chance)[counted].mean()), float(lost)


def trace(seed: int, setup: Setup, fading: Fading) -> Trace:
    rng = np.random.default_rng(seed)
    curves = HiddenCurves.drawn(rng, TABLE, setup.most_offset_db)
    times = np.arange(setup.slots) * setup.slot_s
    shadow, every = Shadowing(rng, setup.shadow_sigma_db, setup.shadow_correlation_m), 200
    step_m = fading.speed_mps * setup.slot_s * every
    points = [shadow.moved(step_m) for _ in range(setup.slots // every + 2)]
    slow = np.interp(np.arange(setup.slots) / every, np.arange(len(points)), points)
    mean = rng.uniform(*setup.mean_snr_db) + slow
    snr = effective_snr_db(mean, fading.trace(rng, times))
    noisy = snr + rng.normal(0, setup.report_noise_db, setup.slots)
    reports = noisy[np.maximum(0, np.arange(setup.slots) - setup.report_delay_slots)]
    arrives = curves.goodputs(snr[:, None]) / EFFICIENCY
    return Trace(setup, curves, snr, reports, arrives, rng.random(setup.slots))


def forecasts(channel: Trace) -> list[tuple[float, float]]:
    """The ratio at the time of sending and how far off that usually is, by slot."""
    setup = channel.setup
    forecaster = LinearForecaster(
        setup.report_delay_slots, setup.memory_slots, 1.0, groups=setup.groups
    )
    return [(forecaster.sample(one), forecaster.deviation) for one in channel.reports.tolist()]


def ours(channel: Trace, expected: list[tuple[float, float]], target: float | None) -> np.ndarray:
    """Choice by expected goodput, learnt from what arrived."""
    setup = channel.setup
    adapter = GoodputAdapter(target, TABLE)
    chosen = np.zeros(setup.slots, np.int64)
    pending = []
    for slot, forecast in enumerate(expected):
        if slot >= setup.ack_delay_slots:
            adapter.feedback(*pending[slot - setup.ack_delay_slots])
        choice = adapter.choose(*forecast)
        chosen[slot] = choice.mcs
        is_lost = channel.draws[slot] > channel.arrives[slot, choice.mcs]
        pending.append((choice, float(not is_lost), float(is_lost)))
    return chosen


def outer_loop(channel: Trace) -> np.ndarray:
    """Inner loop on the newest report and outer loop, the usual way."""
    setup = channel.setup
    adapter = LinkAdapter(TABLE, OuterLoop(setup.target_bler, 0.01))
    chosen = np.zeros(setup.slots, np.int64)
    lost = np.zeros(setup.slots, bool)
    for slot, report in enumerate(channel.reports.tolist()):
        heard = slot - setup.ack_delay_slots
        if heard >= 0:
            adapter.feedback(float(not lost[heard]), float(lost[heard]), int(chosen[heard]))
        chosen[slot] = adapter.choose(report)
        lost[slot] = channel.draws[slot] > channel.arrives[slot, chosen[slot]]
    return chosen


def inner_loop(channel: Trace) -> np.ndarray:
    """What the model says of the newest report, nothing learnt."""
    return np.array([best_mcs(TABLE, report, 0.1).index for report in channel.reports.tolist()])


def rule(channel: Trace) -> np.ndarray:
    """The rule of WirelessROS on the mean of each 100 blocks."""
    chosen, mcs = [], 0
    for start in range(0, channel.setup.slots, 100):
        chosen += [mcs] * 100
        part = slice(start, start + 100)
        bler = float((channel.draws[part] > channel.arrives[part, mcs]).mean())
        mcs = feedback_step(TABLE, mcs, bler, float(channel.reports[start + 99]), 1.0)
    return np.array(chosen)


def attainable(channel: Trace, limit: float | None) -> float:
    """Goodput of who knows the best weights of past reports and the true curves, losing at most so much."""
    setup, curves = channel.setup, channel.curves
    counted = slice(setup.warm_up_slots, None)
    edges = (*range(17), 20, 24, 32, 48, 80)
    inputs = recent_means(channel.reports, edges)
    weights = np.linalg.lstsq(inputs[counted], channel.snr_db[counted], rcond=None)[0]
    forecast = inputs @ weights
    deviation = float((channel.snr_db - forecast)[counted].std())
    z = np.linspace(-3, 3, 21)
    chances = np.exp(-(z**2) / 2) / np.exp(-(z**2) / 2).sum()
    ratios = np.arange(-25.0, 45.0, 0.05)
    arrives = sum(
        chance * curves.goodputs(ratios[:, None] + deviation * at)
        for at, chance in zip(z, chances, strict=True)
    )
    arrives = arrives / EFFICIENCY
    place = np.clip(((forecast + 25) / 0.05).round().astype(int), 0, ratios.size - 1)

    def priced(price: float) -> tuple[float, float]:
        best = (EFFICIENCY * arrives + price * arrives).argmax(1)
        return channel.goodput(best[place])

    free = priced(0.0)
    if limit is None or free[1] > 100 * limit:
        return free[0]
    low, high = -3.0, 0.0
    for _ in range(14):
        middle = (low + high) / 2
        low, high = (middle, high) if priced(middle)[1] > 100 * limit else (low, middle)
    return priced(high)[0]


def one_seed(seed: int, setup: Setup, fading: Fading) -> list[float]:
    channel = trace(seed, setup, fading)
    genie = channel.goodput(np.argmax(channel.arrives * EFFICIENCY, axis=1))[0]
    expected = forecasts(channel)
    own, lost = channel.goodput(ours(channel, expected, setup.target_bler))
    free, free_lost = channel.goodput(ours(channel, expected, None))
    best = attainable(channel, None)
    return [
        100 * own / genie,
        lost,
        100 * attainable(channel, setup.target_bler) / genie,
        100 * best / genie,
        100 * free / genie,
        free_lost,
        100 * channel.goodput(outer_loop(channel))[0] / genie,
        100 * channel.goodput(inner_loop(channel))[0] / genie,
        100 * channel.goodput(rule(channel))[0] / genie,
        abs(channel.curves.offset_db),
    ]


COLUMNS = [
    Column("ours, of genie", "%", min, "bar: >= 90"),
    Column("ours, blocks lost", "%", lambda v: max(v, key=lambda x: abs(x - 10)), "bar: 8..12"),
    Column("attainable at that loss, of genie", "%", min),
    Column("attainable at any loss, of genie", "%", min),
    Column("ours without a target, of genie", "%", min),
    Column("ours without a target, blocks lost", "%", max),
    Column("best simple (outer loop), of genie", "%", min),
    Column("inner loop alone, of genie", "%", min),
    Column("rule of WirelessROS, of genie", "%", min),
    Column("hidden offset, absolute", "dB", max),
]


def main() -> None:
    options = arguments(__doc__ or "")
    setup = Setup()
    for name, fading in SCENARIOS.items():
        print_parameters(f"uplink adaptation, {name} (SIMULATED)", setup, fading)
        rows = by_seed(partial(one_seed, setup=setup, fading=fading), options)
        print_table(COLUMNS, rows, options.verbose)


if __name__ == "__main__":
    main()
