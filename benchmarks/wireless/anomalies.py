"""Anomalies: precision and recall on injected events; the plain threshold of WirelessROS beside it.

SIMULATED. `python benchmarks/wireless/anomalies.py [--seeds 20]`
"""

from __future__ import annotations

from dataclasses import dataclass
from statistics import fmean

import numpy as np
from common import Column, arguments, print_parameters, print_table

from simple_ros_engines.radio_information.anomalies import (
    THRESHOLDS,
    AnomalyKind,
    AnomalyWatch,
)
from simple_ros_engines.simulator.link import Disturbance, LinkSettings, SimulatedLink


@dataclass(frozen=True)
class Setup:
    """Parameters of the generator; an event is a step of some size for some samples."""

    samples: int = 6000
    warm_up: int = 60
    every: tuple[int, int] = (80, 160)
    lasts: tuple[int, int] = (5, 20)
    loss_db: tuple[float, float] = (9.0, 18.0)
    hidden_db: tuple[float, float] = (6.0, 12.0)
    rtt_ms: tuple[float, float] = (60.0, 200.0)
    tolerance: int = 8


def events(setup: Setup, rng) -> list[tuple[int, int, AnomalyKind, Disturbance]]:
    found, at = [], setup.warm_up
    while True:
        at += int(rng.integers(*setup.every))
        end = at + int(rng.integers(*setup.lasts))
        if end + setup.tolerance >= setup.samples:
            return found
        kind = list(AnomalyKind)[int(rng.integers(3))]
        what = {
            AnomalyKind.SNR_DROP: Disturbance(loss_db=rng.uniform(*setup.loss_db)),
            AnomalyKind.BLER_SPIKE: Disturbance(hidden_db=rng.uniform(*setup.hidden_db)),
            AnomalyKind.LATENCY_SPIKE: Disturbance(rtt_ms=rng.uniform(*setup.rtt_ms)),
        }[kind]
        found.append((at, end, kind, what))


class Plain:
    """Newest value against the mean of the four before it; no memory, no spread."""

    def __init__(self) -> None:
        self.before: dict = {kind: [] for kind in AnomalyKind}
        self.on: set = set()

    def sample(self, record) -> list[AnomalyKind]:
        side, began = record.side(), []
        values = (side.snr_db, side.bler, record.get("rtt_ms"))
        for kind, value in zip(AnomalyKind, values, strict=True):
            past = self.before[kind]
            if len(past) > 5:
                change = (value - fmean(past[-4:])) * (-1 if kind is AnomalyKind.SNR_DROP else 1)
                if change > THRESHOLDS[kind]:
                    if kind not in self.on:
                        began.append(kind)
                    self.on.add(kind)
                else:
                    self.on.discard(kind)
            past.append(value)
        return began


def judged(setup: Setup, injected, alarms: list[tuple[int, AnomalyKind]]) -> tuple[float, float]:
    """Precision and recall. A strong drop also costs blocks, so those alarms count for the event."""
    found, wrong = set(), 0
    alarms = [(at, kind) for at, kind in alarms if at >= setup.warm_up]
    for at, kind in alarms:
        near = [
            index
            for index, (start, end, _, _) in enumerate(injected)
            if start <= at <= end + setup.tolerance
        ]
        hit = [index for index in near if injected[index][2] is kind]
        found.update(hit)
        wrong += not near
    right = len(alarms) - wrong
    return right / max(1, right + wrong), len(found) / len(injected)


def one_seed(seed: int, setup: Setup, settings: LinkSettings) -> list[float]:
    rng = np.random.default_rng(seed)
    link = SimulatedLink(rng, settings)
    injected = events(setup, rng)
    by_sample = {at: what for start, end, _, what in injected for at in range(start, end)}
    watch, plain = AnomalyWatch(), Plain()
    ours, theirs = [], []
    for at in range(setup.samples):
        record = link.step(by_sample.get(at, Disturbance()))
        ours += [(at, change.kind) for change in watch.sample(record) if change.began]
        theirs += [(at, kind) for kind in plain.sample(record)]
    return [*judged(setup, injected, ours), *judged(setup, injected, theirs), len(injected)]


COLUMNS = [
    Column("ours, precision", "", min, "bar: >= 0.9"),
    Column("ours, recall", "", min, "bar: >= 0.9"),
    Column("plain threshold, precision", "", min),
    Column("plain threshold, recall", "", min),
    Column("events", "", min),
]


def main() -> None:
    options = arguments(__doc__ or "")
    setup, settings = Setup(), LinkSettings(offered_bps=2e6)
    print_parameters("anomalies (SIMULATED)", setup, settings)
    rows = [one_seed(seed, setup, settings) for seed in range(1, options.seeds + 1)]
    print_table(COLUMNS, rows, options.verbose)


if __name__ == "__main__":
    main()
