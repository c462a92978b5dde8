"""Interference that reports do not show: recall on injected interferers, alarms in an hour without any.

WirelessROS' correlation of ratio and error rate stands beside it. SIMULATED.
`python benchmarks/wireless/interference.py [--seeds 20]`
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from common import Column, arguments, by_seed, print_parameters, print_table
from traces import (
    DRIVING_MPS,
    WALKING_MPS,
    CellTraffic,
    StreetLink,
    street,
    street_fading,
)

from simple_ros_engines.radio_information.interference import InterferenceWatch
from simple_ros_engines.simulator.link import Disturbance, LinkSettings, SimulatedLink


@dataclass(frozen=True)
class Setup:
    """Parameters of the generator; 10 samples a second."""

    quiet_samples: int = 36_000
    samples: int = 12_000
    every: tuple[int, int] = (400, 700)
    lasts: tuple[int, int] = (30, 100)
    hidden_db: tuple[float, float] = (4.0, 10.0)
    tolerance: int = 10


def correlated(snrs: list[float], blers: list[float]) -> bool:
    """What WirelessROS takes for interference: a correlation above -0.5 over 30 samples."""
    one, other = np.array(snrs[-30:]), np.array(blers[-30:])
    if one.std() == 0 or other.std() == 0:
        return False
    return bool(np.corrcoef(one, other)[0, 1] > -0.5)


def made(
    seed: int, samples: int, speed_mps: float | None
) -> tuple[np.random.Generator, SimulatedLink]:
    rng = np.random.default_rng(seed)
    if speed_mps is None:
        return rng, SimulatedLink(rng, LinkSettings())
    settings, fading = street(speed_mps), street_fading(speed_mps)
    return rng, StreetLink(rng, settings, fading, CellTraffic(), samples)


def quiet_hour(seed: int, setup: Setup, speed_mps: float | None) -> tuple[int, float]:
    _, link = made(seed, setup.quiet_samples, speed_mps)
    watch, alarms, theirs, looked = InterferenceWatch(), 0, 0, 0
    snrs: list[float] = []
    blers: list[float] = []
    for at in range(setup.quiet_samples):
        side = (record := link.step()).side()
        alarms += watch.sample(record) is True
        snrs.append(side.snr_db)
        blers.append(side.bler)
        if at % 300 == 299:
            looked += 1
            theirs += correlated(snrs, blers)
    return alarms, theirs / looked


def injected(seed: int, setup: Setup, speed_mps: float | None) -> tuple[float, float]:
    """Recall, and the median of how long it took, s."""
    rng, link = made(10_000 + seed, 2 * setup.samples, speed_mps)
    watch = InterferenceWatch()
    at, total, delays = 0, 0, []
    while at < setup.samples:
        for _ in range(int(rng.integers(*setup.every))):
            watch.sample(link.step())
            at += 1
        what = Disturbance(hidden_db=rng.uniform(*setup.hidden_db))
        lasts = int(rng.integers(*setup.lasts))
        delay, hurt = None, 0.0
        for index in range(lasts + setup.tolerance):
            record = link.step(what if index < lasts else Disturbance())
            watch.sample(record)
            at += 1
            hurt = max(hurt, record.values["ul_bler"]) if index < 5 else hurt
            if watch.is_present and delay is None:
                delay = index / 10
        # An interferer that costs no blocks (far above the last scheme) is none.
        if hurt > 0.3:
            total += 1
            delays += [] if delay is None else [delay]
    return len(delays) / max(1, total), float(np.median(delays)) if delays else float("nan")


def one_seed(seed: int, setup: Setup, speed_mps: float | None) -> list[float]:
    alarms, theirs = quiet_hour(seed, setup, speed_mps)
    recall, delay = injected(seed, setup, speed_mps)
    return [recall, alarms, delay, 100 * theirs]


COLUMNS = [
    Column("ours, recall", "", min, "bar: >= 0.9"),
    Column("ours, alarms in a quiet hour", "", max, "bar: 0"),
    Column("ours, time to alarm", "s", max),
    Column("best simple (WirelessROS' correlation): share of quiet windows flagged", "%", max),
]
SCENARIOS = {
    "walking, mild shadowing, white fading": None,
    "walking 3 km/h in a street canyon": WALKING_MPS,
    "driving 60 km/h in a street canyon": DRIVING_MPS,
}


def main() -> None:
    options = arguments(__doc__ or "")
    setup = Setup()
    for name, speed in SCENARIOS.items():
        shown = [LinkSettings()]
        if speed is not None:
            shown = [street(speed), street_fading(speed), CellTraffic()]
        print_parameters(f"interference, {name} (SIMULATED)", setup, *shown)
        rows = by_seed(partial(one_seed, setup=setup, speed_mps=speed), options)
        print_table(COLUMNS, rows, options.verbose)


if __name__ == "__main__":
    main()
